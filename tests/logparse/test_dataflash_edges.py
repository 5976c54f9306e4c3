"""What is odd but lawful in DataFlash logs: every field type, redefinitions, decoys, strange FMT rows, clocks."""

import io
import struct
import time
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from logparse.dataflash.binary import DataflashSource
from logparse.dataflash.format import FIELD_TYPES, FMT, HEADER, Definition
from logparse.dataflash.writer import DataflashWriter

BOUNDS = {char: np.iinfo(kind.dtype) for char, kind in FIELD_TYPES.items() if kind.dtype.kind in "iu"}


def row(message_id: int, payload: bytes) -> bytes:
    return HEADER + bytes((message_id,)) + payload


def fmt(message_id: int, length: int, name: str, form: str, labels: str) -> bytes:
    return Definition(message_id, length, name, form, tuple(labels.split(","))).pack()


def stamped(message_id: int, time_us: int, payload: bytes = b"") -> bytes:
    return row(message_id, struct.pack("<Q", time_us) + payload)


def field_values(char: str) -> st.SearchStrategy[object]:
    """Values that a field of this type can hold, as the writer takes them."""
    kind = FIELD_TYPES[char]
    if kind.is_text:
        letters = st.characters(codec="utf-8", exclude_characters="\0")
        return st.text(letters, max_size=kind.size).filter(lambda text: len(text.encode()) <= kind.size)
    if char == "a":
        return st.lists(st.integers(-32768, 32767), min_size=32, max_size=32)
    if kind.dtype.kind == "f":
        return st.floats(width=kind.dtype.itemsize * 8)  # type: ignore[arg-type]
    whole = st.integers(int(BOUNDS[char].min), int(BOUNDS[char].max))
    return whole.map(lambda k: k / kind.divisor) if kind.divisor != 1 else whole


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, list[list[object]]]:
    form = draw(st.text(st.sampled_from("bBhHiIqQgfdMnNcCeELZa"), min_size=1, max_size=8).filter(_fits))
    rows = draw(st.lists(st.tuples(*(field_values(char) for char in form)), min_size=1, max_size=5))
    return form, [list(column) for column in zip(*rows, strict=True)]


def _fits(form: str) -> bool:
    return 3 + 8 + sum(FIELD_TYPES[char].size for char in form) <= 255


@given(table=tables())
@example(table=("Q", [[1_000_000, 2**63]]))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_what_is_written_is_read(table: tuple[str, list[list[object]]]) -> None:
    """Any format, any values: integers and scaled integers exactly, floats bit for bit, text to the letter."""
    form, columns = table
    labels = [f"F{k}" for k in range(len(form))]
    stream = io.BytesIO()
    writer = DataflashWriter(stream)
    writer.define("X", "Q" + form, ["TimeUS", *labels])
    n = len(columns[0])
    written = {"TimeUS": np.arange(n, dtype=np.uint64) + 5, **dict(zip(labels, columns, strict=True))}
    writer.write_table("X", written)
    source = DataflashSource(stream.getvalue())
    assert source.findings == ()
    frame = source.decode("X", source.boots[0])
    assert frame["TimeUS"].tolist() == list(range(5, 5 + n))
    for char, label, values in zip(form, labels, columns, strict=True):
        kind = FIELD_TYPES[char]
        column = frame[label]
        if char == "a":
            np.testing.assert_array_equal(np.stack(column.to_numpy()), np.array(values))
        elif kind.is_text:
            assert column.tolist() == values
        elif kind.dtype.kind == "f":
            np.testing.assert_array_equal(column.to_numpy(), np.array(values, kind.dtype).astype(column.dtype))
        elif kind.divisor != 1:
            stored = np.rint(np.array(values) * kind.divisor)
            np.testing.assert_array_equal(np.rint(column.to_numpy(np.float64) * kind.divisor), stored)
            np.testing.assert_allclose(column.to_numpy(), np.array(values), rtol=1e-7)
        else:
            assert column.dtype == kind.dtype
            assert column.tolist() == values


def test_multipliers_are_applied_once() -> None:
    """FMTU's multiplier scales plain numbers; beside a legacy character it only repeats that character's scale."""
    stream = io.BytesIO()
    writer = DataflashWriter(stream)
    writer.define("M", "QBhcLIff", "TimeUS,I,MagX,Alt,Lat,GMS,Volt,Free", "s#GmDsv-", "F-CBGCA-")
    writer.write("M", 1_000_000, 2, 0.321, 12.34, -35.3632621, 130040.903, 1.25, 7.5)
    source = DataflashSource(stream.getvalue())
    frame = source.decode("M", source.boots[0])
    raw = stream.getvalue()[-(3 + 8 + 1 + 2 + 2 + 4 + 4 + 4 + 4) :]
    assert struct.unpack("<QBhhiIff", raw[3:]) == (1_000_000, 2, 321, 1234, -353632621, 130040903, 12.5, 7.5)
    assert frame["TimeUS"].tolist() == [1_000_000]
    assert frame.index.tolist() == [1.0]
    assert frame["MagX"].iloc[0] == np.float32(0.321)
    assert frame["Alt"].iloc[0] == np.float32(12.34)
    assert frame["Lat"].iloc[0] == -35.3632621
    assert frame["GMS"].iloc[0] == 130040.903
    assert frame["Volt"].iloc[0] == np.float32(1.25)
    assert frame["Free"].iloc[0] == 7.5
    assert frame.attrs["multipliers"] == {"MagX": 1e-3, "Alt": 1e-2, "Lat": 1e-7, "GMS": 1e-3, "Volt": 0.1}
    assert frame.attrs["units"] == {
        "TimeUS": "us", "MagX": "Gauss", "Alt": "m", "Lat": "deglatitude", "GMS": "s", "Volt": "V",
    }  # fmt: skip
    assert frame.attrs["instance"] == "I"


def test_text_is_cut_at_nul_and_odd_bytes_are_kept_as_letters() -> None:
    data = FMT.pack() + fmt(1, 31, "T", "QnN", "TimeUS,A,B")
    data += stamped(1, 10, b"ab\0d" + b"caf\xc3\xa9\0\xff\xfe" + bytes(8))
    data += stamped(1, 20, b"\xe9\0\0\0" + b"x" * 16)
    source = DataflashSource(data)
    frame = source.decode("T", source.boots[0])
    assert frame["A"].tolist() == ["ab", "é"]
    assert frame["B"].tolist() == ["café", "x" * 16]
    assert str(frame["A"].dtype) == "str"


def test_pieces_of_files_stay_bytes() -> None:
    data = FMT.pack() + fmt(1, 88, "FILE", "NIBZ", "FileName,Offset,Length,Data")
    content = bytes(range(64))
    data += row(1, b"a.txt".ljust(16, b"\0") + struct.pack("<IB", 0, 64) + content)
    source = DataflashSource(data)
    assert source.decode("FILE", source.boots[0])["Data"].tolist() == [content]


def test_redefinition_holds_from_its_place_on() -> None:
    """One id, first a byte, then a float under another label, then another message altogether."""
    data = FMT.pack()
    data += fmt(1, 12, "X", "QB", "TimeUS,A") + stamped(1, 1_000_000, b"\x07") + stamped(1, 2_000_000, b"\x08")
    data += fmt(1, 15, "X", "Qf", "TimeUS,B") + stamped(1, 3_000_000, struct.pack("<f", 0.5))
    data += fmt(1, 13, "Y", "Qh", "TimeUS,C") + stamped(1, 4_000_000, struct.pack("<h", -3))
    source = DataflashSource(data)
    (boot,) = source.boots
    assert source.counts(boot) == {"FMT": 4, "X": 3, "Y": 1}
    x = source.decode("X", boot)
    assert x.index.tolist() == [1.0, 2.0, 3.0]
    pd.testing.assert_series_equal(
        x["A"].reset_index(drop=True), pd.Series([7, 8, np.nan]), check_names=False, check_dtype=False
    )
    assert x["B"].tolist()[2] == 0.5
    assert source.decode("Y", boot)["C"].tolist() == [-3]
    assert [finding.id for finding in source.findings] == ["message-layout"]


def test_contradictory_format_is_ignored_until_used() -> None:
    """A length that the format does not have: no word while no message follows it, then what fits is read."""
    odd = fmt(2, 20, "ODD", "QB", "TimeUS,A")
    plain = fmt(1, 12, "X", "QB", "TimeUS,A")
    unused = DataflashSource(FMT.pack() + odd + plain + stamped(1, 1, b"\x07"))
    assert unused.findings == ()
    assert unused.decode("X", unused.boots[0])["A"].tolist() == [7]
    declared = stamped(2, 5, b"\x09" + bytes(8))
    by_format = stamped(2, 6, b"\x0a")
    for message, value in ((declared, 9), (by_format, 10)):
        used = DataflashSource(FMT.pack() + odd + plain + stamped(1, 1, b"\x07") + message + stamped(1, 7, b"\x08"))
        assert used.decode("X", used.boots[0])["A"].tolist() == [7, 8]
        assert used.decode("ODD", used.boots[0])["A"].tolist() == [value]
        (finding,) = used.findings
        assert (finding.id, "declare" in finding.reason) == ("message-layout", True)


def test_labels_and_format_characters_that_do_not_match_or_are_not_known() -> None:
    """A FMT row that describes itself with four labels for five fields, and rows with too few or many labels."""
    data = fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format")
    data += fmt(1, 14, "FEW", "QBh", "TimeUS,A") + fmt(2, 12, "MANY", "QB", "TimeUS,A,B")
    data += fmt(3, 14, "NEW", "QB?", "TimeUS,A,B") + stamped(3, 3, b"\x09\x01\x02")
    data += stamped(1, 1, b"\x07\x01\x00") + stamped(2, 2, b"\x08")
    source = DataflashSource(data)
    (boot,) = source.boots
    assert list(source.decode("FMT", boot).columns) == ["Type", "Length", "Name", "Format", "Columns"]
    assert source.decode("FMT", boot)["Columns"].tolist()[0] == "Type,Length,Name,Format"
    assert source.decode("FEW", boot)[["A", "field3"]].to_numpy().tolist() == [[7, 1]]
    assert list(source.decode("MANY", boot).columns) == list(source.decode("NEW", boot).columns) == ["TimeUS", "A"]
    assert source.decode("NEW", boot)["A"].tolist() == [9]


def test_unknown_types_do_not_stop_the_reader() -> None:
    """An index like pymavlink's ends at the first message without a FMT row; everything behind it is here."""
    data = FMT.pack() + fmt(1, 12, "X", "QB", "TimeUS,A")
    for k in range(50):
        data += stamped(1, 1000 * k, bytes((k,))) + row(77, bytes(range(30)))
    data += stamped(1, 100_000, b"\xff")
    source = DataflashSource(data)
    assert source.decode("X", source.boots[0])["A"].tolist() == [*range(50), 255]
    by_id = {finding.id: finding for finding in source.findings}
    assert by_id["message-layout"].evidence == {"messages": 50, "ids": "77"}


def test_decoy_headers_in_payloads_are_not_messages() -> None:
    """Text that holds headers and whole messages: harmless in an intact chain, and after a break one is not enough."""
    data = FMT.pack() + fmt(1, 75, "T", "QZ", "TimeUS,Text") + fmt(2, 12, "X", "QB", "TimeUS,A")
    decoy = stamped(2, 5, b"\x63")
    texts = [
        decoy.ljust(64, b"\0"),
        (b"\xa3\x95\x02" * 21).ljust(64, b"\0"),
        (bytes(52) + decoy),
        (b"ab" + decoy + b"\xa3" * 10).ljust(64, b"\0"),
    ]
    rows = [
        part for k, text in enumerate(texts) for part in (stamped(1, 10 * k, text), stamped(2, 10 * k, bytes((k,))))
    ]
    source = DataflashSource(data + b"".join(rows))
    (boot,) = source.boots
    assert source.counts(boot) == {"FMT": 3, "T": 4, "X": 4}
    assert source.decode("X", boot)["A"].tolist() == [0, 1, 2, 3]
    # The same with the text's own header broken: its decoys come to light.
    broken = b"".join(b"\0" + part[1:] if part is rows[0] or part is rows[6] else part for part in rows)
    source = DataflashSource(data + broken)
    assert source.counts(source.boots[0]) == {"FMT": 3, "T": 2, "X": 4}
    assert source.decode("X", source.boots[0])["A"].tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_redefinitions_without_end_are_read_by_their_own_layouts_within_bounds() -> None:
    """More than a byte can number; each layout of one name would add a column to a table of all their rows."""
    data = [FMT.pack()]
    for k in range(300):
        data += [fmt(1, 12, "X", "QB", f"TimeUS,A{k}"), stamped(1, 1000 * k, bytes((k % 256,))) * 100]
    begun = time.process_time()
    source = DataflashSource(b"".join(data))
    frame = source.decode("X", source.boots[0])
    assert frame.size < 8_000_000 + sum(map(len, data))
    layouts = frame.drop(columns="TimeUS")
    assert layouts.shape[1] > 256
    for label, column in layouts.items():
        assert column.dropna().tolist() == [int(str(label)[1:]) % 256] * 100
    (damage,) = [finding for finding in source.findings if finding.id == "file-damaged"]
    assert "changes more often" in damage.reason
    assert time.process_time() - begun < 60.0


def write_boot(start_us: int, rows: int, step_us: int = 10_000) -> bytes:
    """Write a whole log of one boot, with its FMT rows."""
    data = FMT.pack() + fmt(1, 12, "X", "QB", "TimeUS,A") + fmt(2, 4, "U", "B", "A")
    for k in range(rows):
        data += row(2, bytes((k % 256,))) + stamped(1, start_us + k * step_us, bytes((k % 256,)))
    return data


def test_several_boots_are_kept_apart() -> None:
    """Logs behind one another in one file; each boot begins with its FMT rows and has its own clock."""
    parts = [write_boot(100_000_000, 300), write_boot(20_000_000, 500), write_boot(5_000_000, 40)]
    source = DataflashSource(b"".join(parts))
    assert [boot.t_start for boot in source.boots] == pytest.approx([100.0, 20.0, 5.0])
    assert [boot.t_end for boot in source.boots] == pytest.approx([102.99, 24.99, 5.39])
    starts = np.cumsum([0, *map(len, parts)])
    assert [(boot.start, boot.stop) for boot in source.boots] == list(pairwise(starts))
    assert [source.counts(boot) for boot in source.boots] == [{"FMT": 3, "U": n, "X": n} for n in (300, 500, 40)]
    second = source.decode("X", source.boots[1])
    assert second.index[0] == 20.0
    assert second.index.is_monotonic_increasing
    assert [finding.id for finding in source.findings] == ["several-in-file"]


def test_a_log_behind_another_is_a_power_up_of_its_own_though_its_clock_is_later() -> None:
    """Two downloads in one file; the FMT row of FMT, with which every log begins, tells it from a pause."""
    pause = b"".join(stamped(1, 500_000_000 + 10_000 * k, b"\0") for k in range(50))
    parts = [write_boot(20_000_000, 300) + pause, write_boot(900_000_000, 200)]
    source = DataflashSource(b"".join(parts))
    assert [(boot.start, boot.stop) for boot in source.boots] == [
        (0, len(parts[0])),
        (len(parts[0]), sum(map(len, parts))),
    ]
    assert [boot.t_start for boot in source.boots] == pytest.approx([20.0, 900.0])


@pytest.mark.parametrize("misplaced", ["swapped", "twice"])
def test_misplaced_blocks_of_one_power_up_are_put_in_order(misplaced: str) -> None:
    """A card that mixes its blocks up; rows without a clock lie between those with one."""
    whole = write_boot(20_000_000, 6000)
    a, b = len(whole) // 3, 2 * len(whole) // 3
    moved = whole[:a] + whole[b:-900] + whole[a:b] + whole[-900:] if misplaced == "swapped" else whole[:b] + whole[a:]
    source = DataflashSource(moved)
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == pytest.approx((20.0, 79.99))
    t = source.decode("X", boot).index
    # Of the rows where blocks meet halves are left.
    assert len(t) >= 6000 - 4
    assert t.is_monotonic_increasing
    assert np.diff(t).max() < 0.05
    assert [finding.id for finding in source.findings].count("file-damaged") >= 1


def test_what_an_old_log_left_on_the_card_is_no_part_of_the_new_one() -> None:
    """Its rows tell the same seconds in another way."""
    old, new = (
        b"".join(stamped(1, start + 10_000 * k, b"\0") for k in range(3000)) for start in (40_003_000, 20_000_000)
    )
    source = DataflashSource(FMT.pack() + fmt(1, 12, "X", "QB", "TimeUS,A") + new + old)
    assert [boot.t_start for boot in source.boots] == pytest.approx([20.0, 40.003])


def test_rows_slightly_back_long_pauses_and_odd_stamps_are_one_boot() -> None:
    """What 4.x logs do all the time (rows late by milliseconds), holes of 400 s, a flipped time stamp."""
    times = [1_000_000 + 10_000 * k for k in range(400)]
    for k in range(10, 400, 20):
        times[k] -= 25_000
    times = times + [t + 400_000_000 for t in times] + [t + 900_000_000 for t in times[:3]]
    clean = list(times)
    times[200] = 2**40 + 5
    times[600] = 7
    data = FMT.pack() + fmt(1, 12, "X", "QB", "TimeUS,A")
    source = DataflashSource(data + b"".join(stamped(1, t, b"\0") for t in times))
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == pytest.approx((1.0, 901.02))
    frame = source.decode("X", boot)
    np.testing.assert_allclose(frame.index, np.array(clean) * 1e-6, atol=0.05)
    assert frame["TimeUS"].iloc[200] == 2**40 + 5
    assert [(f.id, f.evidence["rows"]) for f in source.findings] == [("clock-doubtful", 2)]


def test_no_flipped_bit_of_a_clock_makes_another_boot() -> None:
    for bit in range(64):
        check_one_boot_with_flipped(bit)


def check_one_boot_with_flipped(bit: int) -> None:
    times = [100_000_000 + 10_000 * k for k in range(2000)]
    data = bytearray(FMT.pack() + fmt(1, 12, "X", "QB", "TimeUS,A"))
    begin = len(data)
    data += b"".join(stamped(1, t, b"\0") for t in times)
    for k in (0, 700, 1990):
        data[begin + 12 * k + 3 + bit // 8] ^= 1 << (bit % 8)
    source = DataflashSource(bytes(data))
    (boot,) = source.boots
    t = source.decode("X", boot).index.to_numpy()
    # A first row that is too early cannot be told from one before a pause.
    np.testing.assert_allclose(t[1:], np.array(times[1:]) * 1e-6, atol=5.0)


def test_dropped_messages_of_the_autopilot_are_told() -> None:
    stream = io.BytesIO()
    writer = DataflashWriter(stream)
    writer.define("DSF", "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv")
    for k, dropped in enumerate((0, 3, 12)):
        writer.write("DSF", 1_000_000 * k, dropped, 0, 0, 0, 0, 0)
    (finding,) = DataflashSource(stream.getvalue()).findings
    assert (finding.id, finding.evidence["messages"]) == ("log-gaps", 12)


def test_damaged_definitions_of_the_units_are_survived() -> None:
    """UNIT, MULT, FMTU and DSF rows whose FMT rows make something else of their columns."""
    stream = io.BytesIO()
    writer = DataflashWriter(stream)
    writer.define("DSF", "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv", "s------", "F------")
    writer.write("DSF", 1_000_000, 5, 0, 0, 0, 0, 0)
    for old, new in (("QbZ\0", "QnZ\0"), ("Qbd\0", "Qba\0"), ("QBNN\0", "QNBN\0"), ("QIHIIII\0", "QnHIIII\0")):
        data = stream.getvalue().replace(old.encode(), new.encode(), 1)
        assert data != stream.getvalue()
        source = DataflashSource(data)
        for name in source.counts(source.boots[0]):
            assert source.decode(name, source.boots[0]) is not None
        assert source.findings is not None
