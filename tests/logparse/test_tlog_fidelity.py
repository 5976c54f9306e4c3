"""Every message of every shared telemetry log, against pymavlink.

Each frame that pymavlink gives must be a row here, with the same values in every field, and there may be no others.
"""

from collections import defaultdict

import numpy as np
import pandas as pd
import pytest
from pymavlink import mavutil

from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.tlog import TlogSource
from logparse.source import Boot
from tests.paths import SHARED

#: Text logs and JSON are also named .log.
TELEMETRY = [*sorted(SHARED.glob("*/*.tlog")), *sorted(SHARED.glob("real/kevinaangstadt*.log"))]

#: The largest, which is half of all, where there is time.
COMPARED = [
    pytest.param(path, marks=pytest.mark.whole if path.stat().st_size > 5_000_000 else (), id=path.name)
    for path in TELEMETRY
]

pytestmark = pytest.mark.skipif(not TELEMETRY, reason="the shared logs are not beside the project")


def positions_by_pymavlink(path):
    """Where pymavlink finds frames, by the start byte of each."""
    connection = mavutil.mavlogfile(str(path))
    frames = []
    while (message := connection.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA":
            frames.append(connection.f.tell() - len(message.get_msgbuf()))
    connection.close()
    return np.array(frames)


def marks_of(source):
    """Where the reader finds frames."""
    return np.sort(np.concatenate([chunk.ordered for chunk in source.scan.chunks])).astype(np.int64)


def decoded_by_pymavlink(data, marks):
    """Decode the frames there: name -> list of (system, component, values in the order of the fields)."""
    link = pymavlink_dialect().MAVLink(None)
    rows = defaultdict(list)
    for mark in marks:
        length = data[mark + 1]
        size = length + 8 if data[mark] == 0xFE else length + 12 + 13 * (data[mark + 2] & 1)
        message = link.decode(bytearray(data[mark : mark + size]))
        name = message.get_type()
        values = [getattr(message, field) for field in definitions()[name].fields]
        rows[name].append((message.get_srcSystem(), message.get_srcComponent(), *values))
    return rows


@pytest.fixture(scope="module", params=COMPARED)
def pair(request):
    data = request.param.read_bytes()
    source = TlogSource(data)
    # Decoding verifies the checksum, so that a frame which pymavlink does not accept fails here.
    return source, Boot(0, len(data), 0.0, 0.0), decoded_by_pymavlink(data, marks_of(source))


@pytest.mark.parametrize("path", COMPARED)
def test_frames_are_those_of_pymavlink(path):
    ours, theirs = marks_of(TlogSource(path.read_bytes())), positions_by_pymavlink(path)
    assert not np.setdiff1d(theirs, ours).size
    extra = np.setdiff1d(ours, theirs).tolist()
    # Behind the ten stray bytes of this log pymavlink loses an intact frame (`pair` decodes it with its checksum).
    assert extra == ([496911] if path.name.startswith("kevinaangstadt") else [])


def test_counts(pair):
    source, whole, expected = pair
    assert source.counts(whole) == {name: len(rows) for name, rows in expected.items()}
    by_boot = [pd.Series(source.counts(boot)) for boot in source.boots]
    pd.testing.assert_series_equal(
        pd.concat(by_boot).groupby(level=0).sum(), pd.Series(source.counts(whole)).sort_index(), check_names=False
    )


def test_values(pair):
    source, whole, expected = pair
    frames = source.decode_many(expected, whole)
    for name, rows in expected.items():
        frame = frames[name]
        systems, components, *columns = zip(*rows, strict=True)
        np.testing.assert_array_equal(frame["system"], systems)
        np.testing.assert_array_equal(frame["component"], components)
        for field, values in zip(definitions()[name].fields, columns, strict=True):
            if isinstance(values[0], str):
                # pymavlink keeps what stands behind the NUL that ends a text.
                assert frame[field].tolist() == [text.partition("\0")[0] for text in values], f"{name}.{field}"
            elif isinstance(values[0], list):
                got = np.stack([frame[f"{field}[{k}]"] for k in range(len(values[0]))], axis=1)
                np.testing.assert_array_equal(got, np.array(values, got.dtype), f"{name}.{field}")
            else:
                np.testing.assert_array_equal(frame[field], np.array(values, frame[field].dtype), f"{name}.{field}")


def test_own_boot_time_is_the_index(pair):
    source, whole, _ = pair
    frame = source.decode("ATTITUDE", whole)
    np.testing.assert_array_equal(frame.index, frame["time_boot_ms"] / 1e3)


def test_times_of_other_messages_lie_between_those_around_them(pair):
    source, _, _ = pair
    for boot in source.boots:
        attitude = source.decode("ATTITUDE", boot)
        for name in ("VFR_HUD", "SYS_STATUS"):
            t = source.decode(name, boot).index.to_numpy()
            assert t.min() > boot.t_start - 5.0
            assert t.max() < boot.t_end + 5.0
            # A radio stutters; between two messages with boot time, times may step back by a clock window at most.
            assert np.diff(t).min() > -1.1
        assert boot.t_start <= attitude.index.min() <= attitude.index.max() <= boot.t_end


@pytest.mark.parametrize(
    ("name", "boots"),
    [
        ("brunoolivieri", [(684.661, 1010.245)]),
        ("code-lever", [(36.407, 613.131)]),
        ("mbiuki", [(12.54, 225.013), (26.202, 652.424)]),
        (
            "pypi-fasttlogparser",
            [(103.656, 259.474), (15.986, 84.275), (17.754, 1188.048), (20.115, 861.118), (13.772, 73.147)],
        ),
    ],
)
def test_power_ups_are_told_apart(name, boots):
    """The restarts were found by hand: time_boot_ms starts again, sequence numbers at 0 and "Initialising APM..."."""
    (path,) = (path for path in TELEMETRY if path.name.startswith(name))
    source = TlogSource(path.read_bytes())
    assert [(boot.t_start, boot.t_end) for boot in source.boots] == boots
    assert source.boots[0].start == 0
    assert source.boots[-1].stop == path.stat().st_size
    for before, after in zip(source.boots, source.boots[1:], strict=False):
        assert before.stop == after.start


def test_frames_lost_as_counted_independently():
    """The inventory of the logs counts 3051 and 3829 vehicle frames lost by sequence number."""
    for name, lost in (("mbiuki", 3051), ("pypi-fasttlogparser", 3829)):
        (path,) = (path for path in TELEMETRY if path.name.startswith(name))
        (finding,) = (f for f in TlogSource(path.read_bytes()).findings if f.id == "log-gaps")
        assert finding.evidence["frames"] == lost


def test_damage_of_shared_logs_is_reported():
    def findings(name):
        (path,) = (path for path in TELEMETRY if path.name.startswith(name))
        return {finding.id: finding.evidence for finding in TlogSource(path.read_bytes()).findings}

    assert findings("kevinaangstadt")["file-damaged"]["bytes"] == 10
    assert findings("kevinaangstadt")["file-damaged"]["first_byte"] == 496893
    assert findings("code-lever")["file-end"] == {"first_byte": 720953, "bytes": 9}
    assert findings("pypi-fasttlogparser")["file-end"]["first_byte"] == 5865441
