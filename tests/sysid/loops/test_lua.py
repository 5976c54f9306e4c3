"""The Lua script of a design, run against stubs of ArduPilot's bindings, and missions as pymavlink reads them."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavwp

from sysid.loops import Limits
from sysid.loops.lua import multisine_script, orthogonal_multisines
from sysid.loops.missions import drag_legs, position_legs, thrust_legs, waypoints

LUA = shutil.which("lua5.3")
BINDINGS = Path(__file__).with_name("bindings.lua")
SCALES = (0.3, 0.25, 0.2)


@pytest.fixture(scope="module")
def sines():
    return orthogonal_multisines(3, 0.3, 4.5, 20.0)


@pytest.fixture
def run(tmp_path, sines):
    if LUA is None:
        pytest.skip("lua5.3 is not installed (.ci/run installs it)")
    script = tmp_path / "inertia.lua"
    script.write_text(multisine_script(sines, SCALES, 0.35, Limits(), [("roll gain", 0.01)]))

    def fly(seconds: float, lean_at: float = 1e9) -> tuple[np.ndarray, list[str]]:
        command = [LUA, str(BINDINGS), str(script), str(seconds), str(lean_at)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
        lines = done.stdout.splitlines()
        rows = [[float(each) for each in line.split()] for line in lines if not line.startswith("#")]
        return np.array(rows), [line[2:] for line in lines if line.startswith("#")]

    return fly


def test_a_script_plays_three_periods_within_its_limits_and_gives_the_craft_back(run):
    rows, said = run(80.0)
    assert said == ["rotorid multisine: started", "rotorid multisine: done", "mode 5"]
    t, rates, throttle, angles = rows[:, 0], np.radians(rows[:, 1:4]), rows[:, 4], rows[:, 5:]
    assert t[-1] == pytest.approx(60.0, abs=0.3)
    assert np.all(np.abs(rates).max(axis=0) < np.array(SCALES) + 0.5 * np.abs(angles).max() + 1e-6)
    assert np.all(np.abs(rates).max(axis=0) > 0.7 * np.array(SCALES))
    assert np.degrees(np.abs(angles)).max() < Limits().lean_deg
    assert np.all((throttle > 0.2) & (throttle < 0.55))


def test_what_the_script_plays_is_the_multisine(run, sines):
    """Rates are the sines, less the slow return to level, but for the fades of the first and last two seconds."""
    rows, _ = run(80.0)
    inner = (rows[:, 0] > 3.0) & (rows[:, 0] < 57.0)
    sine = sines[2]
    wanted = SCALES[2] * sine.at(rows[inner, 0])
    # The script counts from its first call in GUIDED; both clocks are whole steps of 10 ms.
    played = np.radians(rows[inner, 3])
    apart = min(
        float(np.abs(played - SCALES[2] * sine.at(rows[inner, 0] + lag)).max()) for lag in np.arange(-3, 4) * 0.01
    )
    assert apart < 1e-4
    assert np.abs(wanted).max() > 0.15


def test_a_script_ends_itself_when_the_craft_leans_too_far(run):
    rows, said = run(80.0, lean_at=10.0)
    assert said == ["rotorid multisine: started", "rotorid multisine: lean", "mode 5"]
    assert rows[-1, 0] < 10.1


@pytest.mark.parametrize("legs", [drag_legs(20.0), thrust_legs(20.0), position_legs(20.0)])
def test_missions_are_those_that_pymavlink_reads(tmp_path, legs):
    path = tmp_path / "x.waypoints"
    path.write_text(waypoints((47.4, 8.5, 488.0), legs))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(path.read_text().splitlines()) - 1
    items = [loader.wp(k) for k in range(loader.count())]
    assert [item.seq for item in items] == list(range(len(items)))
    assert items[1].command == 22
    assert items[-1].command == 21
    places = [(item.x, item.y) for item in items if item.command == 16 and item.seq > 0]
    reach = max(float(np.hypot(leg.north, leg.east)) for leg in legs)
    metres = [
        np.hypot((lat - 47.4) * 111_150.0, (lon - 8.5) * 111_320.0 * np.cos(np.radians(47.4))) for lat, lon in places
    ]
    assert max(metres) == pytest.approx(reach, rel=0.01)
