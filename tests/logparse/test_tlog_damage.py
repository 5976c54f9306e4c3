"""Damaged telemetry: no exception but the documented one, no hang, and every frame that is still whole is read."""

import io
import struct
import time

import numpy as np
import pytest

from logparse import LogError
from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.tlog import TlogSource, looks_like
from logparse.mavlink.writer import TlogWriter
from logparse.source import Boot

UTC_US = 1_700_000_000_000_000


def build_log(frames=60):
    """Build records with a serial number in the payload: either version, some signed, some of an unknown message."""
    dialect = pymavlink_dialect
    plain = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    signing = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    signing.signing.secret_key, signing.signing.sign_outgoing = bytes(32), True
    records = []
    for k in range(frames):
        stamp = struct.pack(">Q", UTC_US + 100_000 * k)
        message = dialect.MAVLink_attitude_message(10_000 + k, 0.1 * k, 0, 0, 0, 0, k)
        if k % 7 == 3:
            frame = b"\xfe" + bytes([6, k % 256, 1, 1, 199]) + b"\xfe\x09\xfd\x02\x01\x00" + b"??"
        elif k % 5 == 1:
            frame = message.pack(signing)
        elif k % 5 == 2:
            frame = dialect.MAVLink_heartbeat_message(14, 3, 0, k, 0, 3).pack(plain)
        else:
            frame = message.pack(plain, force_mavlink1=k % 2 == 0)
        plain.seq = signing.seq = (k + 1) % 256
        records.append(stamp + frame)
    return records


@pytest.mark.parametrize("seed", range(4))
def test_thousands_of_bit_errors(seed):
    """A tenth of a per cent to ten per cent of all bytes hit: all frames that are whole are there."""
    rng = np.random.default_rng(seed)
    records = build_log(2000)
    clean = np.frombuffer(b"".join(records), np.uint8)
    hits = rng.random(len(clean)) < 10 ** rng.uniform(-3, -1)
    log = clean ^ np.where(hits, 1 << rng.integers(0, 8, len(clean)), 0).astype(np.uint8)
    ends = np.cumsum([len(record) for record in records])
    counted = np.concatenate(([0], np.cumsum(hits)))
    starts = np.concatenate(([0], ends[:-1])) + 8
    known = np.array([not (record[8] == 0xFE and record[13] == 199) for record in records])
    # A signature is not part of what the checksum covers.
    signed = np.array([13 * (record[8] == 0xFD and record[10] & 1) for record in records])
    whole = known & (counted[ends - signed] == counted[starts])
    source = TlogSource(log.tobytes())
    marks = set(np.concatenate([chunk.ordered for chunk in source.scan.chunks]).tolist())
    assert not set(starts[whole].tolist()) - marks
    # A damaged frame passes for whole once in 65536.
    assert len(marks - set(starts[whole].tolist())) <= 2


def test_random_bytes_are_read_as_nothing_in_good_time():
    """Worst cases for the search: every byte a start byte, long frames everywhere, noise."""
    rng = np.random.default_rng(0)
    attitude = definitions()["ATTITUDE"].id
    long_frames = (b"\xfd\xff\x00\x00\x00\x01\x01" + attitude.to_bytes(3, "little")) * 50_000
    started = time.process_time()
    for data in (
        rng.integers(0, 256, 1_000_000, np.uint8).tobytes(),
        b"\xfe" * 1_000_000,
        b"\xfe\x1c\x00\x01\x01\x1e" * 150_000,
        long_frames,
        bytes(1_000_000),
        b"".join(bytes(8) + b"\xfe\x00\x00\x01\x01\xc7??" for _ in range(60_000)),
    ):
        looks_like(data[:65536])
        try:
            frames = TlogSource(data).scan.frames
        except LogError:
            frames = 0
        # Chance gives one frame in 65536 start bytes with a known id.
        assert frames < 10
    # 6 MB take half a second; each start byte against all that follows would take hours.
    assert time.process_time() - started < 60.0


def test_an_unknown_message_hides_no_frame():
    """A damaged id of a message is not known; what it seems to hold is not skipped unless a frame follows it."""
    stream = io.BytesIO()
    writer = TlogWriter(stream)
    for k in range(20):
        writer.write(UTC_US + k, "ATTITUDE", time_boot_ms=k + 1)
    data = bytearray(stream.getvalue())
    size = len(data) // 20
    for k in (3, 9):
        data[k * size + 8 + 9] = 0x70  # the id's highest byte
        data[k * size + 8 + 1] = 200  # and the length: it would cover the next frames
    source = TlogSource(bytes(data))
    whole = Boot(0, len(data), 0.0, 0.0)
    assert source.counts(whole)["ATTITUDE"] == 18
