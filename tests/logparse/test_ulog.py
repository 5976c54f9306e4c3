"""PX4 logs: what pyulog reads arrives unchanged, and damage becomes an error or a finding.

The small logs are built here after the format's description (https://docs.px4.io/main/en/dev_log/ulog_file_format.html).
"""

import struct

import numpy as np
import pytest
from pyulog import ULog

from logparse import LogError
from logparse.ulog.reader import UlogSource
from tests.paths import REAL

LOGS = sorted(REAL.glob("*.ulg"))
START = 5_000_000


def message(kind, payload):
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def info(kind, key, value):
    return message(kind, bytes([len(key)]) + key.encode() + value)


def data(subscription, stamp, *rest):
    return message("D", struct.pack("<HQ", subscription, stamp) + b"".join(rest))


def small_log(rows=20):
    """Build a log with two instances of a topic, an array, a text field, parameters, texts and a dropout."""
    parts = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", START),
        message("B", bytes(40)),
        message("F", b"gyro:uint64_t timestamp;float[3] rate;uint8_t _padding0;"),
        message("F", b"note:uint64_t timestamp;char[8] text;"),
        info("I", "char[4] sys_name", b"PX4\0"),
        info("P", "int32_t SYS_AUTOSTART", struct.pack("<i", 6001)),
        info("P", "float MC_ROLL_P", struct.pack("<f", 6.5)),
        message("A", struct.pack("<BH", 0, 1) + b"gyro"),
        message("A", struct.pack("<BH", 1, 2) + b"gyro"),
        message("A", struct.pack("<BH", 0, 3) + b"note"),
        data(3, START, b"caf\xc3\xa9\0x\0"),
    ]
    for k in range(rows):
        for instance in (1, 2):
            rates = struct.pack("<3f", k, 10 * instance, -k)
            parts.append(data(instance, START + 4000 * k + instance, rates))
    parts += [
        message("L", b"4" + struct.pack("<Q", START + 1000) + b"[commander] Takeoff detected\t"),
        message("C", b"6" + struct.pack("<HQ", 7, START + 500) + b"tagged"),
        message("O", struct.pack("<H", 250)),
        info("P", "float MC_ROLL_P", struct.pack("<f", 7.25)),
    ]
    return b"".join(parts)


def place(log, k):
    """Return where the k-th message of the first instance begins."""
    return log.find(struct.pack("<HQ", 1, START + 4000 * k + 1)) - 3


def test_topics_instances_arrays_texts_parameters_and_dropouts():
    source = UlogSource(small_log())
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == (5.0, 5.076002)
    assert source.parameters(boot) == {"SYS_AUTOSTART": 6001.0, "MC_ROLL_P": 7.25}, "the last values"
    (finding,) = source.findings
    assert (finding.id, finding.evidence) == ("log-gaps", {"dropouts": 1, "seconds": 0.25, "longest": 0.25})
    assert source.counts(boot) == {"gyro": 20, "gyro_1": 20, "note": 1, "information": 1, "logged_messages": 2}
    gyro = source.decode("gyro_1", boot)
    assert list(gyro.columns) == ["timestamp", "rate[0]", "rate[1]", "rate[2]"]
    assert gyro.index.name == "t"
    np.testing.assert_allclose(gyro.index, 5.000002 + 0.004 * np.arange(20), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(gyro["rate[2]"], -np.arange(20, dtype=np.float32))
    assert source.decode("note", boot)["text"].tolist() == ["café"]
    assert source.decode("logged_messages", boot)["message"].tolist() == ["tagged", "[commander] Takeoff detected"]
    assert source.decode("logged_messages", boot)["level"].tolist() == [6, 4]
    assert source.decode("information", boot)["value"].tolist() == ["PX4"]


def test_a_topic_subscribed_to_again_is_one_table():
    row = data(9, START + 90_000, struct.pack("<3f", 1, 2, 3))
    again = message("A", struct.pack("<BH", 0, 9) + b"gyro") + row
    source = UlogSource(small_log() + again)
    gyro = source.decode("gyro", source.boots[0])
    assert len(gyro) == source.counts(source.boots[0])["gyro"] == 21
    assert gyro.index.is_monotonic_increasing


def test_a_field_whose_name_is_lost_costs_no_other():
    parts = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", START),
        message("F", b"odd:uint64_t timestamp;float ;float x;"),
        message("A", struct.pack("<BH", 0, 1) + b"odd"),
        *(data(1, START + 1000 * k, struct.pack("<2f", 7.0, k)) for k in range(3)),
    ]
    source = UlogSource(b"".join(parts))
    assert source.decode("odd", source.boots[0])["x"].tolist() == [0.0, 1.0, 2.0]


def test_damage_is_a_finding_and_says_nothing_on_stdout(capsys):
    log = bytearray(small_log())
    at = log.find(struct.pack("<HQ", 1, START + 4001))
    log[at : at + 2] = b"\xee\xee"  # data of a topic that nobody subscribed to
    source = UlogSource(bytes(log))
    assert "file-damaged" in [finding.id for finding in source.findings]
    assert len(source.decode("gyro", source.boots[0])) == 19
    assert capsys.readouterr().out == ""


#: What stands in place of the length and the kind of a message: where they end there is no message, or one by chance.
HEADERS = {
    **{f"length {length}": struct.pack("<H", length) for length in (0, 5, 300, 60_000)},
    # A kind that no message of this length has: a sound one follows it, as behind one of a newer kind.
    **{f"kind {ord(kind)}": struct.pack("<HB", 22, ord(kind)) for kind in "RSO\0"},
    # A message with a name that ends where a sound one begins: all between would be its value.
    **{f"named {kind}": struct.pack("<HB", 7 * 50 - 3, ord(kind)) for kind in "IMFP"},
}


@pytest.mark.parametrize("header", HEADERS)
def test_a_damaged_header_costs_its_own_message_and_no_other(header):
    """Behind one, pyulog goes astray until a sync message, which this log does not have."""
    log = bytearray(small_log())
    at, end = (place(log, k) for k in (1, 8))
    assert (log[at : at + 3], end - at) == (struct.pack("<HB", 22, ord("D")), 7 * 50)
    log[at : at + len(HEADERS[header])] = HEADERS[header]
    source = UlogSource(bytes(log))
    counts = source.counts(source.boots[0])
    assert (counts["gyro"], counts["gyro_1"], counts["logged_messages"]) == (19, 20, 2)
    assert source.parameters(source.boots[0])["MC_ROLL_P"] == 7.25
    (finding,) = [finding for finding in source.findings if finding.id == "file-damaged"]
    assert finding.evidence["bytes"] == 3 + 2 + 8 + 12


def test_appended_data_is_found_behind_damage_and_a_message_cut_short():
    """A log cut off in flight gets the crash dump appended, at an offset that its first message holds."""
    log = bytearray(small_log() + message("D", bytes(24))[:-9])
    log[19 + 8 : 19 + 17] = b"\x01" + bytes(7) + b"\0"
    log[19 + 16 : 19 + 24] = struct.pack("<Q", len(log))
    log += message("M", b"\0" + bytes([len(b"char[4] hardfault")]) + b"char[4] hardfaultdump")
    at = place(log, 1)
    del log[at : at + 2]
    log[19 + 16 : 19 + 24] = struct.pack("<Q", struct.unpack_from("<Q", log, 19 + 16)[0] - 2)
    source = UlogSource(bytes(log))
    assert source.counts(source.boots[0])["gyro"] == 19
    assert "autopilot-error" in [finding.id for finding in source.findings]


def test_messages_of_a_kind_that_is_not_known_are_no_damage():
    log = small_log()
    at = place(log, 1)
    source = UlogSource(log[:at] + message("Z", b"of a later format") + log[at:])
    assert source.counts(source.boots[0])["gyro"] == 20
    assert "file-damaged" not in [finding.id for finding in source.findings]


def test_a_long_message_that_holds_messages_is_one():
    """PX4 logs carry packed metadata of a kilobyte and more, which a search takes for anything."""
    log = small_log()
    inner = log[place(log, 1) :][:500] * 4
    at = log.find(struct.pack("<HQ", 2, START + 4002)) - 3
    source = UlogSource(log[:at] + message("M", b"\0" + bytes([10]) + b"uint8_t[] x"[:10] + inner) + log[at:])
    assert source.counts(source.boots[0])["gyro"] == 20
    assert "file-damaged" not in [finding.id for finding in source.findings]


@pytest.mark.parametrize("size", [0, 7, 16, 200])
def test_a_log_without_data_is_an_error(size):
    with pytest.raises(LogError, match=r"damaged|no data"):
        UlogSource(small_log()[:size])


@pytest.mark.skipif(not LOGS, reason="the shared logs are not beside the project")
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_shared_logs_hold_what_pyulog_reads(path):
    source = UlogSource(path.read_bytes())
    (boot,) = source.boots
    reference = ULog(str(path))
    assert "file-damaged" not in [finding.id for finding in source.findings]  # they are whole
    counts = source.counts(boot)
    for topic in reference.data_list:
        name = topic.name if topic.multi_id == 0 else f"{topic.name}_{topic.multi_id}"
        frame = source.decode(name, boot)
        assert counts[name] == len(frame) == len(topic.data["timestamp"])
        np.testing.assert_allclose(frame.index, topic.data["timestamp"] / 1e6, rtol=0, atol=1e-9)
        for field in topic.field_data:
            if field.type_str != "char":
                np.testing.assert_array_equal(frame[field.field_name], topic.data[field.field_name])
    assert source.parameters(boot) == {k: float(v) for k, v in reference.initial_parameters.items()}


def test_a_bug_of_ours_is_no_damage_of_the_log(monkeypatch):
    """What pyulog stumbles over is the log's fault; what our own code beneath it raises is not, nor is memory."""
    with monkeypatch.context() as broken:
        broken.setattr("logparse.ulog.reader._Handle._asked", property(lambda self: 0))
        with pytest.raises(AttributeError, match="no setter"):
            UlogSource(small_log())

    def full(self, *_):
        raise MemoryError

    monkeypatch.setattr("pyulog.ULog._load_file", full)
    with pytest.raises(MemoryError):
        UlogSource(small_log())
