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


def marks_of(source):
    """Where the reader finds frames."""
    return np.sort(np.concatenate([chunk.ordered for chunk in source.scan.chunks])).astype(np.int64)


def read_by_pymavlink(path):
    """Return the messages that pymavlink finds, by the place of each frame."""
    connection, messages = mavutil.mavlogfile(str(path)), {}
    while (message := connection.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA":
            messages[connection.f.tell() - len(message.get_msgbuf())] = message
    connection.close()
    return messages


@pytest.fixture(scope="module", params=COMPARED)
def pair(request):
    """Return the reader of a log, all of it as one power-up, and senders and values of its frames by pymavlink."""
    data = request.param.read_bytes()
    source, messages = TlogSource(data), read_by_pymavlink(request.param)
    ours = marks_of(source).tolist()
    assert messages.keys() <= set(ours)
    extra = [mark for mark in ours if mark not in messages]
    # Behind the ten stray bytes of this log pymavlink loses an intact frame; decoding verifies its checksum.
    assert extra == ([496911] if request.param.name.startswith("kevinaangstadt") else [])
    rows = defaultdict(list)
    for mark in ours:
        message = messages.get(mark)
        if not isinstance(message, pymavlink_dialect.MAVLink_message):  # of version 1 it leaves out later fields
            frame = data[mark : mark + data[mark + 1] + 8] if message is None else message.get_msgbuf()
            message = pymavlink_dialect.MAVLink(None).decode(bytearray(frame))
        name = message.get_type()
        values = [getattr(message, field) for field in definitions()[name].fields]
        rows[name].append((message.get_srcSystem(), message.get_srcComponent(), *values))
    return source, Boot(0, len(data), 0.0, 0.0), rows


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


def test_times_of_other_messages_lie_between_those_around_them(pair):
    source, _, _ = pair
    for boot in source.boots:
        attitude = source.decode("ATTITUDE", boot)
        np.testing.assert_array_equal(attitude.index, attitude["time_boot_ms"] / 1e3)
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
