"""Damaged DataFlash logs: nothing intact is lost, nothing but `RotoridError` is raised, nothing hangs.

The base log is written by our writer; each row carries a serial number, so that what a reader gets back can be
compared with what was not touched by the damage. The message lengths are chosen so that no message is as long as
several others together: a flipped id would else swallow its neighbours without a trace in the chain of headers.
"""

import io
import time

import numpy as np
import pytest

from core.findings import Severity
from logparse import RotoridError
from logparse.dataflash.binary import DataflashSource
from logparse.dataflash.writer import DataflashWriter
from tests.forms import thinned

TYPES = (("AA", "QIh", 17), ("BB", "QINd", 39), ("CC", "QIffffffff", 47), ("DD", "QIZN", 95))


def base_log(rows: int) -> tuple[bytes, int, list[tuple[int, int, int]]]:
    """Write a log; gives it, the byte where its rows begin, and (start, stop, serial) of each row."""
    stream = io.BytesIO()
    writer = DataflashWriter(stream)
    for name, form, length in TYPES:
        writer.define(name, form, [f"F{k}" if k else "TimeUS" for k in range(len(form))], id=40 + length)
    begin = stream.tell()
    rng = np.random.default_rng(4)
    places = []
    for serial in range(rows):
        name, form, length = TYPES[int(rng.integers(len(TYPES)))]
        values: list[object] = [1_000_000 + 2500 * serial, serial]
        for char in form[2:]:
            values.append({"N": "name", "Z": "text of a message", "h": -5}.get(char, float(rng.normal())))
        start = stream.tell()
        writer.write(name, *values)
        assert stream.tell() - start == length
        places.append((start, stream.tell(), serial))
    return stream.getvalue(), begin, places


BASE, BEGIN, PLACES = base_log(300)


def serials(source: DataflashSource) -> set[int]:
    offsets: set[int] = set()
    for boot in source.boots:
        for name in {"AA", "BB", "CC", "DD"} & set(source.counts(boot)):
            offsets.update(source.decode(name, boot)["F1"].tolist())
    return offsets


def read_or_refuse(data: bytes) -> DataflashSource | None:
    """Read everything in a log; None where it is refused as it should be."""
    try:
        source = DataflashSource(data)
    except RotoridError:
        return None
    for boot in source.boots:
        source.decode_many(source.counts(boot), boot)
    assert source.findings is not None
    return source


def test_a_message_that_leads_to_no_header_is_not_read_as_what_its_damaged_id_says() -> None:
    """Modes that nobody chose and a GPS failsafe that never was, in 26-11-2014_181 and 11-2-2015_112."""
    data = bytearray(BASE)
    start, stop, serial = next(place for place in PLACES if place[1] - place[0] == TYPES[3][2])
    data[start + 2] = 40 + TYPES[1][2]
    source = DataflashSource(bytes(data))
    assert serials(source) == {each for _, _, each in PLACES} - {serial}
    assert source.findings[0].evidence["bytes"] == stop - start


@pytest.mark.parametrize("seed", thinned(range(4), 4))
def test_thousands_of_bit_flips_lose_only_the_rows_around_them(seed: int) -> None:
    """One to three flips at a time; a row is safe unless it or both of its neighbours' headers were hit."""
    rng = np.random.default_rng(seed)
    stops = np.array([b for _, b, _ in PLACES])
    everything = {serial for _, _, serial in PLACES}
    for _ in range(80):
        data = bytearray(BASE)
        bits = rng.integers(BEGIN * 8, len(BASE) * 8, int(rng.integers(1, 4)))
        for bit in bits:
            data[bit // 8] ^= 1 << (bit % 8)
        source = read_or_refuse(bytes(data))
        assert source is not None
        hit = {int(np.searchsorted(stops, bit // 8, "right")) for bit in bits}
        # Between two broken headers a lone row has no second header to confirm it.
        alone = {serial for serial in everything if serial - 1 in hit and serial + 1 in hit}
        assert everything - hit - alone <= serials(source)


def test_every_truncation_keeps_the_rows_before_it() -> None:
    """The last is none: the undamaged log is complete, without a finding."""
    log, begin, places = base_log(9)
    for stop in (*range(0, begin, 17), *range(begin, len(log) + 1)):
        if stop < 89:
            assert read_or_refuse(log[:stop]) is None
            continue
        source = DataflashSource(log[:stop])
        if stop < begin:
            continue
        expected = {serial for _, b, serial in places if b <= stop}
        assert serials(source) == expected
        ends = {begin, *(b for _, b, _ in places)}
        assert [f.id for f in source.findings] == ([] if stop in ends else ["file-end"])


def test_damage_in_the_middle_of_real_formats_is_quick() -> None:
    """A file of nothing but headers, and one of erased flash, are read in time proportional to their size."""
    for data in (BASE + b"\xa3\x95\x80" * 400_000, BASE + b"\xff" * 2_000_000, BASE + b"\xa3\x95\x52" * 400_000):
        begun = time.process_time()
        assert read_or_refuse(data) is not None
        assert time.process_time() - begun < 60.0  # in time that grows with the square it would be hours


def test_a_lost_beginning_is_made_up_for_by_later_definitions() -> None:
    """Rows whose FMT row comes only behind them are read all the same."""
    log, begin, places = base_log(40)
    source = DataflashSource(log[begin:] + log[:begin] + log[begin:])
    counts: dict[str, int] = {}
    for boot in source.boots:
        for name, count in source.counts(boot).items():
            counts[name] = counts.get(name, 0) + count
    assert sum(counts[name] for name in ("AA", "BB", "CC", "DD")) == 2 * len(places)


def test_a_log_without_its_beginning_says_so() -> None:
    """Definitions stand at the beginning: without all of them nothing is read, without some what they define."""
    log, begin, _ = base_log(40)
    with pytest.raises(RotoridError, match="beginning"):
        DataflashSource(log[begin:])
    (finding,) = (finding for finding in DataflashSource(log[100:]).findings if finding.id == "message-layout")
    assert finding.severity is Severity.ERROR


def test_findings_name_the_place_and_are_few() -> None:
    data = bytearray(BASE)
    for start, _, serial in PLACES[10:290:7]:
        data[start] = 0
        assert serial >= 10
    source = DataflashSource(bytes(data) + b"\xff" * 5000)
    by_id = {finding.id: finding for finding in source.findings}
    assert set(by_id) == {"file-damaged", "file-end"}
    assert by_id["file-damaged"].evidence["places"] == 40
    assert by_id["file-damaged"].evidence["first_byte"] == PLACES[10][0]
    assert by_id["file-damaged"].evidence["messages_lost"] == 40
    assert by_id["file-end"].evidence["bytes"] == 5000
