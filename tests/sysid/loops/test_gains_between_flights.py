"""Gains that are changed on the ground, in the log of a flight with chirps: they are of flights to come."""

import struct
from pathlib import Path
from types import SimpleNamespace

import pytest

from logparse import read_log
from sysid.loops import read_settings, tune
from sysid.loops.evidence import no_one_loop, other_settings
from sysid.loops.search import without_integral

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "quad02_delft_systemid.bin"


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


def test_what_was_changed_after_landing_is_put_back_with_the_gains(tmp_path):
    """AutoTune saves an angle P once it landed: gains proposed for the flown one were left beside the other."""
    log = SAMPLE.read_bytes()
    changed = _written(tmp_path, _set_parameter(log, "ATC_ANG_RLL_P", 36.0, _written(tmp_path, log).boot.t_end + 1.0))
    result = tune(changed)
    assert changed.parameters["ATC_ANG_RLL_P"] == 36.0
    assert result.proposed["ATC_ANG_RLL_P"] == result.rollback["ATC_ANG_RLL_P"] == 5.0
    assert any("ATC_ANG_RLL_P changed after the flight" in remark for remark in result.remarks)


def test_an_i_of_nearly_nothing_is_none():
    """Firmware may refuse to arm with an I of 0, so that a little is typed: a hundredth of it was proposed."""
    settings = read_settings(read_log(SAMPLE), "roll")
    assert not without_integral(settings)
    assert without_integral(settings.changed(I=0.002))


def test_flights_with_other_gains_are_not_mixed():
    """Rollback was of one craft and the proposal of another; only an axis' own I may be 0 in its chirps."""

    def flight(name, **parameters):
        at = {"ATC_RAT_RLL_P": 0.1, "ATC_RAT_RLL_I": 0.1, "ATC_ANG_RLL_P": 4.5, "LOG_BITMASK": 1.0} | parameters
        return SimpleNamespace(path=Path(name), flight=SimpleNamespace(start=5.0, stop=9.0), parameters_at=lambda t: at)

    same = [flight("a.bin"), flight("b.bin", ATC_RAT_RLL_I=0.002, LOG_BITMASK=7.0)]
    assert other_settings(same) is None
    other = other_settings([*same, flight("c.bin", ATC_ANG_RLL_P=9.0)])
    assert other is not None
    assert other.startswith("a.bin flew with ATC_ANG_RLL_P 4.5, c.bin with 9")
