"""Files load one by one as ground stations read them, hold nothing that is not proposed, and none of an earlier run."""

import pytest

from core.parameter import Parameter
from logparse import read_log
from pipeline.results.drift import CraftReview
from reports.pages.fleet import craft_page
from sysid.autopilot import AutopilotValue, AutopilotValues, autopilot_values, gathering
from sysid.autopilot.values import ParameterFile, decided, over_flights
from sysid.loops.controller import LoopError
from sysid.loops.parameter_file import read_parameter_file
from sysid.loops.same_craft import other_craft, other_load

EXPO = AutopilotValue("MOT_THST_EXPO", ParameterFile.ESC, 0.3, Parameter(0.6512, 0.02, "", "a\ncurve"))
HOVER = AutopilotValue("MOT_THST_HOVER", ParameterFile.THROTTLE, None, Parameter(None, None, "", "no hover"))


def test_a_file_has_one_line_for_each_value_and_the_reason_on_it(tmp_path):
    (tmp_path / ParameterFile.WIND).write_text("EK3_DRAG_MCOEF,9\n")
    proposed = AutopilotValues(("a.bin",), (EXPO, HOVER))
    assert proposed.write(tmp_path) == [tmp_path / "20_esc.param"]
    assert [path.name for path in tmp_path.iterdir()] == ["20_esc.param"]
    text = (tmp_path / "20_esc.param").read_text(encoding="utf-8")
    assert text == "MOT_THST_EXPO,0.6512  # ± 0.02; was 0.3; a curve\n"
    assert read_parameter_file(text) == proposed.proposed == {"MOT_THST_EXPO": 0.6512}


@pytest.mark.parametrize(
    ("now", "proposed"), [(0.25, {}), (0.10, {"EK3_DRAG_MCOEF": 0.2525}), (None, {"EK3_DRAG_MCOEF": 0.2525})]
)
def test_what_flew_stays_within_its_error(now, proposed):
    flown = {} if now is None else {"EK3_DRAG_MCOEF": now}
    value = decided({"EK3_DRAG_MCOEF": Parameter(0.25251, 0.01, "1/s", "")}, ParameterFile.WIND, flown)
    assert AutopilotValues(("a.bin",), tuple(value)).proposed == proposed


def test_of_each_step_the_newest_flight_that_knows_of_it_counts():
    right = AutopilotValue("MOT_THST_EXPO", ParameterFile.ESC, 0.65, Parameter(None, None, "", "as flown"), right=True)
    pooled = over_flights([("a", (EXPO, HOVER)), ("b", (HOVER,)), ("c", (right,)), ("d", ())])
    assert pooled.values == (right, HOVER)
    assert over_flights([("a", (EXPO, HOVER)), ("b", (HOVER,))]).proposed == {"MOT_THST_EXPO": 0.6512}


def of_axis(kind, axis, value):
    file = ParameterFile.D_FF if kind == "D_FF" else ParameterFile.GAINS
    name = f"ATC_RAT_{axis}_{kind}" if axis else "INS_GYRO_FILTER"
    return AutopilotValue(name, file, 0.0, Parameter(value, None, "", "" if value else "not flown"))


@pytest.mark.parametrize("kind", ["D_FF", "P"])
def test_numbers_of_each_axis_are_those_of_its_own_flight(kind):
    """The published procedure flies one axis in each flight: the last one's had been all that was shown."""
    flights = [
        ("roll", (of_axis(kind, "RLL", 0.01), of_axis(kind, "PIT", None))),
        ("pitch", (of_axis(kind, "RLL", None), of_axis(kind, "PIT", 0.02))),
    ]
    assert over_flights(flights).proposed == {f"ATC_RAT_RLL_{kind}": 0.01, f"ATC_RAT_PIT_{kind}": 0.02}


def test_gains_found_with_another_filter_are_not_mixed_with_those_without():
    opened = ("both", (of_axis("P", "RLL", 0.01), of_axis("P", "PIT", 0.02), of_axis("P", "", 40.0)))
    later = ("roll", (of_axis("P", "RLL", 0.03),))
    assert over_flights([opened, later]).proposed == {"ATC_RAT_RLL_P": 0.03}
    assert over_flights([later, opened]).proposed["INS_GYRO_FILTER"] == 40.0


def test_the_page_of_a_craft_has_them_beside_what_flew():
    asked = AutopilotValues(("a",), (EXPO, HOVER))
    review = CraftReview(
        flights=("a",), pooled=("a",), boundary=None, drift=None, whole=None, since=(), alerts=(), autopilot=asked
    )
    page = craft_page(review, "mine")
    assert "Fly this, then prove" in page
    assert all(text in page for text in ("MOT_THST_EXPO", "0.65 ± 0.02", "no hover"))


@pytest.mark.parametrize("others", [["sample_logs/quad01_davos_esc.bin"], []])
def test_two_craft_and_no_log_are_refused(others):
    logs = [read_log("sample_logs/octa01_zurich_calm.bin"), *map(read_log, others)] if others else []
    with pytest.raises(LoopError, match=r"two craft|no log"):
        autopilot_values(logs)


def test_a_craft_of_the_same_frame_with_more_cells_is_another():
    """An octocopter of 3 kg and one of 8 kg shared their thrust curve and drag, with nothing said."""
    one, other = (read_log("sample_logs/octa01_zurich_calm.bin") for _ in range(2))
    rows = other.messages["BAT"]
    other.messages.replace("BAT", rows.assign(Volt=1.2 * rows["Volt"]))
    assert other_craft(one, other) is None  # fuller
    other = read_log("sample_logs/octa01_zurich_calm.bin")
    other.messages.replace("BAT", rows.assign(Volt=1.34 * rows["Volt"]))
    assert "two craft" in (other_craft(one, other) or "")


def test_a_flight_with_a_payload_shares_no_numbers_with_one_without(monkeypatch):
    """The same pulses at a tenth more voltage carry a fifth more: gains and thrust were of neither load."""
    one, other = (read_log("sample_logs/octa01_zurich_calm.bin") for _ in range(2))
    assert other_load(one, one) is None
    rows = other.messages["BAT"]
    other.messages.replace("BAT", rows.assign(Volt=1.1 * rows["Volt"]))
    assert "1.21 times the thrust" in (other_load(one, other) or "")
    monkeypatch.setattr(gathering, "without_copies", list)  # one flight stands for both
    with pytest.raises(LoopError, match="another payload"):
        autopilot_values([one, other])


def test_the_command_writes_what_it_shows(rotorid_here, tmp_path):
    done = rotorid_here("export", "sample_logs/quad01_davos_esc.bin", "--autopilot", "--out", tmp_path)
    assert done.returncode == 0
    files = sorted(tmp_path.iterdir())
    assert files
    for path in files:
        for name, value in read_parameter_file(path.read_text(encoding="utf-8")).items():
            assert name in done.stdout
            assert value > 0.0
    assert (
        rotorid_here("export", "sample_logs/quad01_davos_esc.bin", "sample_logs/octa01_zurich_calm.bin").returncode == 2
    )
