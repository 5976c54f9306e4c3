"""Gains that are changed on the ground, in the log of a flight with chirps: they are of flights to come."""

import struct

import pytest

from logparse import read_log
from sysid.loops import read_settings, tune
from sysid.loops.evidence import no_one_loop


@pytest.fixture(scope="module")
def log_bytes(unpacked):
    return unpacked("pairs/quad15_id").read_bytes()


def _definition(log: bytes, name: bytes) -> tuple[int, int, str]:
    """Return number, length and format of a message as the log defines it."""
    at = 0
    while True:
        at = log.index(b"\xa3\x95\x80", at) + 3
        number, length, message, form, _ = struct.unpack("<BB4s16s64s", log[at : at + 86])
        if message.rstrip(b"\0") == name:
            return number, length, form.rstrip(b"\0").decode()


def _set_parameter(log: bytes, name: str, value: float, seconds: float) -> bytes:
    """Return the log with a row of PARM at its place in time, before a row of RATE or at the end."""
    number, length, letters = _definition(log, b"PARM")
    codes = {"Q": "Q", "N": "16s", "f": "f"}
    values = {"Q": int(1e6 * seconds), "N": name.encode()}
    fields = [values.pop(letter, None) or value for letter in letters]
    row = b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(codes[each] for each in letters), *fields)
    assert len(row) == length
    mark = b"\xa3\x95" + bytes([_definition(log, b"RATE")[0]])
    at = log.find(mark)
    while at >= 0 and not 0.0 <= 1e-6 * struct.unpack_from("<Q", log, at + 3)[0] - seconds < 1.0:
        at = log.find(mark, at + 1)
    return log[:at] + row + log[at:] if at >= 0 else log + row


def _written(tmp_path, content):
    path = tmp_path / "changed.BIN"
    path.write_bytes(content)
    return read_log(path)


def test_gains_set_after_landing_are_not_those_that_flew(log_bytes, tmp_path):
    """The last value of a parameter was taken for the flown one, with 8 % more P on the way to other margins."""
    flown = _written(tmp_path, log_bytes)
    value = flown.parameters["ATC_RAT_RLL_P"]
    end = flown.boot.t_end
    later = _written(tmp_path, _set_parameter(log_bytes, "ATC_RAT_RLL_P", 1.08 * value, end + 5.0))
    assert later.parameters["ATC_RAT_RLL_P"] == pytest.approx(1.08 * value)
    flying = read_settings(later, "roll").controller.P
    assert flying == pytest.approx(value)
    assert no_one_loop(later) is None


def test_gains_set_between_chirps_are_no_one_loop(log_bytes, tmp_path):
    log = _written(tmp_path, log_bytes)
    middle = 0.5 * (log.flight.start + log.flight.stop)
    value = 1.08 * log.parameters["ATC_RAT_RLL_P"]
    changed = _written(tmp_path, _set_parameter(log_bytes, "ATC_RAT_RLL_P", value, middle))
    assert "ATC_RAT_RLL_P changed" in tune(changed).refused
