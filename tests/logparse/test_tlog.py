"""Telemetry logs made here, with what they hold known."""

import io
import struct
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

from logparse import LogError
from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.tlog import TlogSource, looks_like
from logparse.mavlink.writer import TlogWriter, write_tlog
from logparse.source import Boot

UTC_US = 1_700_000_000_000_000
AUTOPILOT = {"type": 14, "autopilot": 3, "mavlink_version": 3}
GROUND = {"type": 6, "autopilot": 8, "mavlink_version": 3}


class Flight:
    """Writes messages of an autopilot whose radio delays them, into memory."""

    def __init__(self):
        self.stream = io.BytesIO()
        self.writer = TlogWriter(self.stream)
        self.booted = 0.0
        self.delay = 0.05

    def send(self, t, name, system=1, component=1, **fields):
        """Send at boot time `t`, s; received after the delay by a ground station that knows UTC."""
        if "time_boot_ms" in definitions()[name].fields:
            fields.setdefault("time_boot_ms", round(t * 1e3))
        stamp = UTC_US + round((self.booted + t + self.delay) * 1e6)
        self.writer.write(stamp, name, system, component, **fields)

    def fly(self, start, stop, step=0.25):
        """Send a heartbeat each second, attitude with boot time and VFR_HUD without."""
        for k in range(round((stop - start) / step)):
            t = start + k * step
            if k % 4 == 0:
                self.send(t, "HEARTBEAT", **AUTOPILOT)
            self.send(t, "ATTITUDE", roll=t)
            self.send(t, "VFR_HUD", alt=t)
        return self

    @property
    def data(self):
        return self.stream.getvalue()

    def open(self):
        return TlogSource(self.data)


def whole(source):
    return Boot(0, len(source.scan.data), 0.0, 0.0)


def findings(source):
    return {finding.id: finding for finding in source.findings}


def frame_v1(name, seq=0, system=1, component=1, **fields):
    dialect = pymavlink_dialect
    link = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    link.seq = seq
    definition = definitions()[name]
    values = dict.fromkeys(definition.fields, 0) | fields
    return dialect.mavlink_map[definition.id](**values).pack(link, force_mavlink1=True)


# Frames and fields


def random_table(name, rows, seed):
    """Rows of random bytes in every field; float fields hold no NaN whose bits may change."""
    rng = np.random.default_rng(seed)
    columns = {}
    definition = definitions()[name]
    for field in definition.fields:
        dtype, _ = definition.dtype_and_offset(field)
        if dtype.kind == "S":
            letters = rng.integers(33, 127, (rows, dtype.itemsize), np.uint8)
            letters[np.arange(dtype.itemsize) >= rng.integers(0, dtype.itemsize + 1, rows)[:, None]] = 0
            columns[field] = pd.array([row.tobytes().rstrip(b"\0").decode() for row in letters], dtype="str")
            continue
        for k in range(dtype.shape[0] if dtype.shape else 1):
            if dtype.base.kind == "f":
                values = rng.normal(0, 1e3, rows).astype(dtype.base)
            else:
                limits = np.iinfo(dtype.base)
                values = rng.integers(limits.min, limits.max, rows, dtype.base.newbyteorder("="), endpoint=True)
            # Zeros at the end of a payload are not sent.
            values[rng.random(rows) < 0.3] = 0
            columns[f"{field}[{k}]" if dtype.shape else field] = values
    columns["system"] = rng.integers(1, 4, rows).astype(np.uint8)
    columns["component"] = rng.integers(1, 3, rows).astype(np.uint8)
    return pd.DataFrame(columns, index=pd.Index(np.arange(rows) * 0.1, name="t"))


def test_every_message_is_read_as_written_and_written_as_read(tmp_path):
    tables = {name: random_table(name, 6, seed) for seed, name in enumerate(sorted(definitions()))}
    first, second = tmp_path / "first.tlog", tmp_path / "second.tlog"
    start = datetime(2024, 1, 1, tzinfo=UTC)
    write_tlog(first, tables.items(), start)
    data = first.read_bytes()
    source = TlogSource(data)
    assert source.counts(whole(source)) == dict.fromkeys(tables, 6)
    read = source.decode_many(tables, whole(source))
    for name, table in tables.items():
        pd.testing.assert_frame_equal(read[name].reset_index(drop=True), table.reset_index(drop=True), check_exact=True)
        read[name].index = table.index
    write_tlog(second, ((name, read[name]) for name in tables), start)
    assert second.read_bytes() == data


def test_checksums_of_every_length():
    """A payload of any length, in either version by turns, at any place; checksums by pymavlink."""
    prefixes = (b"", b"x", b"xxxxxxx", struct.pack(">Q", UTC_US))
    for size in range(256):
        check_payload_of(size, size % 2 + 1, prefixes[size // 2 % 4])


def check_payload_of(size, version, prefix):
    dialect = pymavlink_dialect
    definition = definitions()["ENCAPSULATED_DATA"]
    payload = bytes(np.random.default_rng(size).integers(1, 256, size, np.uint8))
    head = bytes([size, 0, 0, 7, 1, 1]) + definition.id.to_bytes(3, "little")
    begin, body = (b"\xfd", head) if version == 2 else (b"\xfe", bytes([size, 7, 1, 1, definition.id]))
    checksum = dialect.x25crc(body + payload + bytes([definition.crc_extra])).crc
    frame = begin + body + payload + struct.pack("<H", checksum)
    source = TlogSource(prefix + frame)
    assert source.counts(whole(source)) == {"ENCAPSULATED_DATA": 1}
    row = source.decode("ENCAPSULATED_DATA", whole(source)).iloc[0]
    sent = payload.ljust(definition.wire.itemsize, b"\0")[: definition.wire.itemsize]
    assert int(row["seqnr"]) == int.from_bytes(sent[:2], "little")
    assert bytes(row[[f"data[{k}]" for k in range(253)]].astype("u1")) == sent[2:]
    damaged = bytearray(frame)
    damaged[len(frame) // 2] ^= 0x10
    with pytest.raises(LogError, match="no intact MAVLink frame"):
        TlogSource(struct.pack(">Q", UTC_US) + bytes(damaged))


def test_versions_signatures_and_unknown_messages_side_by_side():
    stamp = struct.pack(">Q", UTC_US)
    dialect = pymavlink_dialect
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing = bytes(32), True
    signed = dialect.MAVLink_attitude_message(2000, 0.5, 0, 0, 0, 0, 0).pack(link)
    old = frame_v1("ATTITUDE", seq=1, time_boot_ms=2100, roll=0.25)
    unknown_v2 = b"\xfd" + bytes([4, 0, 0, 2, 1, 1]) + (9_999_999).to_bytes(3, "little") + b"abcd" + b"??"
    unknown_v1 = b"\xfe" + bytes([4, 3, 1, 1, 199]) + b"\xfe\xfd\xfe\xfd" + b"??"
    assert 199 not in {definition.id for definition in definitions().values()}
    frames = [old, signed, unknown_v2, unknown_v2, signed, unknown_v1, old, unknown_v2]
    source = TlogSource(b"".join(stamp + frame for frame in frames))
    attitude = source.decode("ATTITUDE", source.boots[0])
    assert attitude["roll"].tolist() == [0.25, 0.5, 0.5, 0.25]
    unknown = findings(source)["message-layout"]
    assert unknown.evidence == {"messages": 4, "ids": "9999999, 199"}
    assert "file-damaged" not in findings(source)


# Senders


def test_the_autopilot_is_found_by_its_heartbeats():
    flight = Flight()
    for k in range(40):
        flight.send(k, "HEARTBEAT", 255, 190, **GROUND)
        flight.send(k, "HEARTBEAT", 7, 154, **{**GROUND, "type": 26})
        # A companion with a clock of its own talks most.
        for _ in range(5):
            flight.send(k, "ATTITUDE", 7, 191, time_boot_ms=1000 * k + 500_000)
        flight.send(k, "ATTITUDE", 7, 1)
        if k % 2:
            flight.send(k, "HEARTBEAT", 7, 1, **AUTOPILOT)
    source = flight.open()
    assert source.autopilot == (7, 1)
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == (1.0, 39.0)
    attitude = source.decode("ATTITUDE", boot)
    companion = attitude["component"] == 191
    assert companion.sum() == 200
    # Others are on the vehicle's boot clock by when they arrived.
    assert np.abs(attitude.index[companion] - np.repeat(np.arange(40), 5)).max() < 0.01
    # Without a heartbeat it is whoever tells boot time.
    silent = Flight()
    for k in range(10, 30):
        silent.send(k, "PARAM_VALUE", 255, 190)
        silent.send(k, "PARAM_VALUE", 255, 190)
        silent.send(k, "ATTITUDE", 3, 1)
    assert silent.open().autopilot == (3, 1)
    assert "several-in-file" in findings(silent.open())


def test_of_two_vehicles_the_one_heard_most_is_taken():
    flight = Flight()
    for k in range(10, 60):
        flight.send(k, "HEARTBEAT", 1, 1, **AUTOPILOT)
        flight.send(k, "ATTITUDE", 1, 1)
        if k % 2:
            flight.send(k, "HEARTBEAT", 2, 1, **AUTOPILOT)
            flight.send(k, "ATTITUDE", 2, 1, time_boot_ms=1000 * (k + 700))
    source = flight.open()
    assert source.autopilot == (1, 1)
    assert findings(source)["several-in-file"].evidence["vehicles"] == 2
    assert len(source.boots) == 1


# Clock


def test_messages_without_boot_time_follow_those_around_them():
    """A radio that stalls for 3 s and delivers all at once moves nothing by more than its jitter."""
    rng = np.random.default_rng(4)
    flight = Flight()
    flight.fly(10, 20)
    flight.delay = 3.0
    flight.fly(20, 21)
    for t in np.arange(21, 60, 0.25):
        flight.delay = 0.05 + 0.1 * rng.random()
        flight.fly(t, t + 0.25)
    source = flight.open()
    frame = source.decode("VFR_HUD", source.boots[0])
    error = frame.index - frame["alt"]
    assert np.abs(error).max() < 0.35
    assert np.median(np.abs(error)) < 0.05


#: Pieces of a session: from and to, s of boot time, when that boot was, and how late the radio is; its power-ups.
SESSIONS = {
    "the ground station's clock jumps": ([(10, 40, 0.0, 0.05), (40, 70, -500.0, 0.05)], [(10.0, 69.75)]),
    # The first power-up was heard for 20 s, the second from its 100th second on.
    "restart in a silence": ([(10, 30, 0.0, 0.05), (100, 130, 900.0, 0.05)], [(10.0, 29.75), (100.0, 129.75)]),
    # After 60 s of silence the link delivers 8 s late for some seconds.
    "outage": ([(10, 40, 0.0, 0.05), (100, 104, 0.0, 8.0), (104, 140, 0.0, 0.05)], [(10.0, 139.75)]),
}


@pytest.mark.parametrize("session", SESSIONS)
def test_restarts_are_told_from_clocks_that_jump_and_links_that_fail(session):
    pieces, boots = SESSIONS[session]
    flight = Flight()
    for start, stop, flight.booted, flight.delay in pieces:
        flight.fly(start, stop)
    source = flight.open()
    assert [(boot.t_start, boot.t_end) for boot in source.boots] == boots
    for boot in source.boots:
        frame = source.decode("VFR_HUD", boot)
        assert np.abs(frame.index - frame["alt"]).max() < (8.1 if session == "outage" else 1.0)
    if pieces[1][2] == -500.0:
        assert source.clock.jumps == pytest.approx([-500.0], abs=0.01)
        assert findings(source)["clock-doubtful"].evidence["jumps"] == 1


def test_sessions_whose_stamps_overlap_are_not_interleaved():
    """A stale clock: the second session's stamps begin 500 s before the first one's end, a hole of zeros between."""
    first = Flight().fly(600, 660)
    second = Flight()
    second.booted = 100.0
    second.fly(10, 70)
    source = TlogSource(first.data + bytes(4096) + second.data)
    assert [(boot.t_start, boot.t_end) for boot in source.boots] == [(600.0, 659.75), (10.0, 69.75)]
    for boot in source.boots:
        frame = source.decode("VFR_HUD", boot)
        assert len(frame) == 240
        assert np.abs(frame.index - frame["alt"]).max() < 1.0
    assert findings(source)["file-damaged"].evidence["bytes"] == 4096


def test_a_late_message_is_not_a_restart():
    flight = Flight().fly(10, 40)
    flight.send(40.0, "ATTITUDE", time_boot_ms=12_000)
    source = flight.fly(40, 60).open()
    assert len(source.boots) == 1
    assert source.boots[0].t_end == 59.75


def test_a_boot_begins_with_its_first_words():
    flight = Flight().fly(100, 130)
    flight.send(130.0, "HEARTBEAT", 255, 190, **GROUND)
    flight.booted = 145.0
    flight.send(1.0, "HEARTBEAT", **AUTOPILOT)
    flight.send(1.1, "STATUSTEXT", text="Initialising")
    source = flight.fly(5, 30).open()
    first, second = source.boots
    assert "STATUSTEXT" not in source.counts(first)
    texts = source.decode("STATUSTEXT", second)
    assert texts["text"].tolist() == ["Initialising"]
    assert texts.index[0] == pytest.approx(1.1, abs=0.01)


def test_microseconds_of_32_bits_come_round():
    flight = Flight()
    for k in range(4250, 4350):
        flight.send(k, "HEARTBEAT", **AUTOPILOT)
        flight.send(k, "ATTITUDE")
        flight.delay = 0.4
        flight.send(k, "SERVO_OUTPUT_RAW", time_usec=k * 1_000_000 % 2**32)
        flight.delay = 0.05
    source = flight.open()
    frame = source.decode("SERVO_OUTPUT_RAW", source.boots[0])
    np.testing.assert_array_equal(frame.index, np.arange(4250.0, 4350.0))


@pytest.mark.parametrize("blocks", [[0, 2, 1, 3], [0, 1, 1, 2, 3]], ids=["swapped", "doubled"])
def test_misplaced_blocks_of_one_power_up_are_put_in_order(blocks):
    """The ground station's stamps go back with the boot clock, as they do not where the autopilot starts again."""
    parts = [Flight().fly(start, start + 20).data for start in range(10, 90, 20)]
    source = TlogSource(b"".join(parts[block] for block in blocks))
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == (10.0, 89.75)
    attitude = source.decode("ATTITUDE", boot)
    np.testing.assert_allclose(attitude["roll"], np.arange(10.0, 90.0, 0.25))
    assert "another order" in findings(source)["file-damaged"].reason


def test_times_that_are_no_boot_times_are_disbelieved():
    flight = Flight()
    for k in range(10, 60):
        flight.send(k, "HEARTBEAT", **AUTOPILOT)
        flight.send(k, "ATTITUDE")
        # Since 1970; not known; of the last fix, half a minute ago.
        flight.send(k, "GPS_RAW_INT", time_usec=[UTC_US + k * 1_000_000, 0, (k - 30) * 1_000_000][k % 3] % 2**63)
    source = flight.open()
    frame = source.decode("GPS_RAW_INT", source.boots[0])
    assert np.abs(frame.index - np.arange(10, 60)).max() < 0.01


def test_damaged_stamps_move_nothing_far():
    flight = Flight().fly(10, 40)
    data = bytearray(flight.data)
    marks = np.sort(np.concatenate([chunk.ordered for chunk in flight.open().scan.chunks]))
    rng = np.random.default_rng(1)
    for mark in rng.choice(marks, 40, replace=False):
        data[int(mark) - rng.integers(1, 9)] ^= 1 << rng.integers(8)
    source = TlogSource(bytes(data))
    assert len(source.boots) == 1
    frame = source.decode("VFR_HUD", source.boots[0])
    assert len(frame) == 120
    assert np.abs(frame.index - frame["alt"])[4:-4].max() < 1.3


def test_without_boot_time_the_ground_stations_clock_counts():
    flight = Flight()
    for k in range(10, 40):
        flight.send(k, "HEARTBEAT", **AUTOPILOT)
        flight.send(k, "VFR_HUD", alt=k)
    source = flight.open()
    assert "clock-doubtful" in findings(source)
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == (0.0, 29.0)
    frame = source.decode("VFR_HUD", boot)
    np.testing.assert_allclose(frame.index, frame["alt"] - 10.0, atol=1e-5)


def test_raw_streams_restart_too_and_may_have_no_clock_at_all():
    def raw(data):
        marks = np.sort(np.concatenate([chunk.ordered for chunk in TlogSource(data).scan.chunks])).astype(int)
        return b"".join(data[a : b - 8] for a, b in zip(marks, [*marks[1:], len(data) + 8], strict=True))

    flight = Flight().fly(100, 140)
    source = TlogSource(raw(flight.fly(10, 40).data))
    assert source.format == "mavlink-raw"
    assert [(boot.t_start, boot.t_end) for boot in source.boots] == [(100.0, 139.75), (10.0, 39.75)]
    for boot in source.boots:
        frame = source.decode("VFR_HUD", boot)
        assert np.abs(frame.index - frame["alt"]).max() < 0.3
    assert TlogSource(bytes(200_000) + raw(flight.data)).format == "mavlink-raw", "though it begins with a hole"
    assert TlogSource(bytes(200_000) + flight.data).format == "tlog"
    silent = Flight()
    for k in range(10):
        silent.send(k, "HEARTBEAT", **AUTOPILOT)
    source = TlogSource(raw(silent.data))
    assert source.decode("HEARTBEAT", source.boots[0]).index.tolist() == [0.0] * 10
    assert "unknown and read as 0" in findings(source)["clock-doubtful"].reason


# Parameters


def test_parameters_are_the_last_known_in_the_boot():
    flight = Flight().fly(10, 40)
    flight.send(20, "PARAM_VALUE", param_id="FRAME_CLASS", param_value=3)
    flight.send(21, "PARAM_VALUE", param_id="MOT_SPIN_ARM", param_value=0.1)
    flight.send(22, "PARAM_VALUE", param_id="MOT_SPIN_ARM", param_value=0.2)
    # Those of a gimbal and of another vehicle are not ours.
    flight.send(23, "PARAM_VALUE", 1, 154, param_id="MOT_SPIN_ARM", param_value=7)
    flight.send(23, "HEARTBEAT", 2, 1, **AUTOPILOT)
    flight.send(23, "PARAM_VALUE", 2, 1, param_id="MOT_SPIN_ARM", param_value=8)
    # A ground station writes down what it fetched by file transfer.
    flight.send(24, "PARAM_VALUE", 255, 190, param_id="ABCDEFGHIJKLMNOP", param_value=16)
    flight.booted = 200.0
    flight.fly(5, 30)
    flight.send(30, "PARAM_VALUE", param_id="MOT_SPIN_ARM", param_value=0.3)
    flight.send(30, "PARAM_VALUE", param_id="ONLY_LATER", param_value=1)
    flight.send(31, "PARAM_VALUE", param_id="ONLY_LATER", param_value=2)
    source = flight.fly(31, 40).open()
    first, second = (source.parameters(boot) for boot in source.boots)
    assert first == {
        "FRAME_CLASS": 3.0,
        "MOT_SPIN_ARM": pytest.approx(0.2),
        "ABCDEFGHIJKLMNOP": 16.0,
        "ONLY_LATER": 1.0,
    }
    assert second == {**first, "MOT_SPIN_ARM": pytest.approx(0.3), "ONLY_LATER": 2.0}


def test_px4_sends_integer_parameters_bit_by_bit():
    flight = Flight()
    for k in range(10, 20):
        flight.send(k, "HEARTBEAT", type=2, autopilot=12, mavlink_version=3)
        flight.send(k, "ATTITUDE")
    as_float = struct.unpack("<f", struct.pack("<i", -6001))[0]
    flight.send(20, "PARAM_VALUE", param_id="SYS_AUTOSTART", param_type=6, param_value=as_float)
    flight.send(20, "PARAM_VALUE", param_id="MC_ROLL_P", param_type=9, param_value=6.5)
    source = flight.open()
    assert source.parameters(source.boots[0]) == {"SYS_AUTOSTART": -6001.0, "MC_ROLL_P": 6.5}


# Damage


def test_a_cut_tail_and_unused_storage_are_told_apart():
    data = Flight().fly(10, 20).data
    cut = findings(TlogSource(data[:-3]))["file-end"]
    assert "ends inside a" in cut.reason
    assert cut.evidence["bytes"] < 60
    assert findings(TlogSource(data + b"\xff" * 5000))["file-end"].evidence == {
        "first_byte": len(data),
        "bytes": 5000,
    }
    noise = bytes(np.random.default_rng(0).integers(0, 200, 5000, np.uint8))
    assert findings(TlogSource(data + noise))["file-end"].evidence["first_byte"] == len(data)
    assert not {"file-end", "file-damaged"} & findings(TlogSource(data)).keys()


def test_messages_of_another_dialect_are_named():
    stamp = struct.pack(">Q", UTC_US)
    body = bytes([9, 0, 1, 1, definitions()["RADIO"].id]) + bytes(9)
    foreign = b"\xfe" + body + struct.pack("<H", pymavlink_dialect.x25crc(body + b"\x99").crc)
    data = Flight().fly(10, 20).data
    source = TlogSource(data + (stamp + foreign) * 20 + Flight().fly(20, 30).data)
    assert source.counts(whole(source))["ATTITUDE"] == 80
    assert findings(source)["message-layout"].evidence == {"messages": "RADIO (20)", "frames": 20}


def test_what_is_no_telemetry_is_an_error():
    for data in (b"", b"hello", b"\xfe", b"\xfd" * 500, b"\xfe" * 100_000, bytes(1000)):
        with pytest.raises(LogError):
            TlogSource(data)


def test_recognised_by_content():
    data = Flight().fly(10, 20).data
    assert looks_like(data)
    assert looks_like(data[:60]), "a heartbeat and a piece"
    assert looks_like(b"garbage" + data[3:])
    assert looks_like(data[8:])
    assert not looks_like(b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n" * 100)
    assert not looks_like(b"\xa3\x95\x80" + bytes(range(256)) * 50)
    assert not looks_like(np.random.default_rng(0).integers(0, 256, 65536, np.uint8).tobytes())
    assert not looks_like(b"")
