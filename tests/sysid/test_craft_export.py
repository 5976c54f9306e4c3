"""Exports of an identified craft: the simulator's own formulae give the craft back; the hover model is eq. 17."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat

from logparse import MissingDataError, Vehicle
from logparse.craft.frames import motor_table
from simulation import kim2017 as paper
from simulation.controllers import hover_linearisation
from sysid.rigid_body.craft_export import frame_json, write_craft
from sysid.rigid_body.hover import hover_from_speeds, hover_model
from sysid.rigid_body.model import ROTATION_UNITS, TRANSLATION_UNITS, RigidBodyModel
from sysid.rigid_body.model_record import BodyParameter

G = 9.80665
OCTA = Vehicle(motors=motor_table("octa", "plus"), spin_min=0.15, spin_max=0.95, thrust_expo=0.65)
#: The simulator's default craft of 3 kg on an octocopter frame, as its formulae make it (sea level, full voltage).
VALUES = {
    "thrust": 3.3285,
    "thrust_expo": 0.65,
    "drag_linear_x": 0.25,
    "drag_linear_y": 0.25,
    "drag_quadratic_x": 0.0356,
    "drag_quadratic_y": 0.0356,
    "climb_loss": 0.0169,
    "motor_lag": 0.02,
    "roll_gain": 152.0,
    "pitch_gain": 151.0,
    "yaw_gain": 3.6,
    "roll_damping": 0.0582,
    "pitch_damping": 0.0582,
    "yaw_damping": 0.0582,
}


def body(missing=(), **changes) -> RigidBodyModel:
    values = dict.fromkeys((*TRANSLATION_UNITS, *ROTATION_UNITS), 0.0) | VALUES | changes
    parameters = {
        name: BodyParameter(
            name,
            {**TRANSLATION_UNITS, **ROTATION_UNITS}[name],
            None if name in missing else value,
            None if name in missing else 0.02 * abs(value),
            name not in missing,
            "not flown" if name in missing else "",
            value,
        )
        for name, value in values.items()
    }
    return RigidBodyModel(
        name="rigid body",
        parameters=parameters,
        estimated=("thrust",),
        covariance=np.eye(1),
        condition=1.0,
        rotor_drag=True,
        axis_drag=True,
        mass=3.0,
        vehicle=OCTA,
        reference_density=1.225,
        reference_voltage=12.6,
        flights={},
        rotation_fit={},
        rmse=0.1,
        training=("flight",),
        findings=(),
    )


def test_the_simulator_s_formulae_give_the_craft_back():
    """SIM_Frame.cpp in a few lines, independently of the export, at sea level."""
    frame = frame_json(body(), arm=0.35).frame
    n, m, rho = frame["num_motors"], frame["mass"], 1.225
    full = m * G / (n * frame["hoverThrOut"])
    assert full / m == pytest.approx(VALUES["thrust"])
    outflow = 2.0 * frame["refVoltage"] * frame["refCurrent"] / (m * G)
    area = m * G / (0.5 * rho * outflow**2)
    assert 0.5 * rho * area / m == pytest.approx(VALUES["climb_loss"], rel=1e-4)
    momentum = frame["mdrag_coef"] * math.sqrt(rho * frame["disc_area"] * m * G) / m
    assert momentum == pytest.approx(VALUES["drag_linear_x"], rel=1e-6)
    lean, speed = math.radians(frame["refAngle"]), frame["refSpd"]
    drag = m * G * math.tan(lean) - math.cos(lean) * frame["mdrag_coef"] * speed * math.cos(lean) * math.sqrt(
        m * G / math.cos(lean) * rho * frame["disc_area"]
    )
    assert drag / (0.5 * rho * speed**2) * 0.5 * rho / m == pytest.approx(VALUES["drag_quadratic_x"], rel=1e-4)
    assert math.radians(400.0) / frame["refRotRate"] == pytest.approx(0.0582)
    jx, jy, jz = frame["moment_inertia"]
    assert full * frame["diagonal_size"] / jx == pytest.approx(VALUES["roll_gain"])
    assert full * frame["diagonal_size"] / jy == pytest.approx(VALUES["pitch_gain"])
    assert jz == pytest.approx(jx + jy)
    # Yaw: slope over the command about hover of yaw_factor c 0.05 D T against yaw_gain g'(c).
    c, step = np.roots([0.65, 0.35, -G / (n * VALUES["thrust"])]).max(), 1e-5

    def torque(command):
        return -frame["motor1_yaw"] * command * 0.05 * 0.35 * full * (0.35 * command + 0.65 * command**2)

    slope = (torque(c + step) - torque(c - step)) / (2.0 * step) / jz
    assert slope == pytest.approx(VALUES["yaw_gain"] * (0.35 + 1.3 * c), rel=1e-6)


def test_drag_too_strong_for_a_reference_flight_at_ten_metres_per_second():
    frame = frame_json(body(drag_quadratic_x=0.5, drag_quadratic_y=0.5)).frame
    assert frame["refSpd"] < 10.0
    assert 0.0 < frame["refAngle"] < 60.0


def test_what_flight_does_not_tell_is_named():
    export = frame_json(body(missing=("climb_loss", "yaw_gain", "motor_lag"), climb_loss=0.0), disc_area=0.385)
    assert {"diagonal_size", "refCurrent", "battCapacityAh", "motor1_yaw", "slew_max"} <= set(export.undetermined)
    assert "thrust" not in export.undetermined
    assert set(export.frame) <= set(export.notes)
    assert export.frame["mdrag_coef"] == pytest.approx(0.2, rel=0.05)
    # Without an arm the default stands in and inertia follows it: the craft turns the same.
    longer = frame_json(body(), arm=0.7).frame["moment_inertia"]
    assert longer == pytest.approx([2.0 * moment for moment in frame_json(body(), arm=0.35).frame["moment_inertia"]])


def test_no_frame_without_mass_or_thrust():
    with pytest.raises(MissingDataError, match="needs the mass"):
        frame_json(replace(body(), mass=None))
    with pytest.raises(MissingDataError, match="thrust is not determined"):
        frame_json(body(missing=("thrust",)))


def test_hover_model_of_kim_2017():
    """Eq. 17 with the printed numbers is the simulator's linearisation, and all eigenvalues of A are zero."""
    craft, speeds = paper.quadcopter(16.0), paper.TRIM_SPEEDS[-1]
    expected_a, expected_b = hover_linearisation(craft, speeds)
    hover = hover_from_speeds(
        speeds,
        paper.THRUST_COEFFICIENTS[-1],
        paper.TORQUE_COEFFICIENTS[-1],
        np.diag(paper.INERTIA),
        [mount.position[0] for mount in craft.rotors],
        [mount.position[1] for mount in craft.rotors],
        [mount.spin for mount in craft.rotors],
    )
    assert pytest.approx(expected_a) == hover.A
    assert pytest.approx(expected_b) == hover.B
    assert hover.B[2:4] == pytest.approx(paper.PRINTED_INPUT[:2], abs=1.6e-4)
    assert hover.eigenvalues == pytest.approx([0.0] * 5)
    assert hover.controllable


def test_hover_model_of_a_rigid_body():
    model = hover_model(body())
    c = model.trim[0]
    assert 8.0 * VALUES["thrust"] * (0.35 * c + 0.65 * c * c) == pytest.approx(G)
    slope = 0.35 + 1.3 * c
    assert model.B[3, 0] == pytest.approx(VALUES["pitch_gain"] * slope)
    assert model.B[2, 7] == pytest.approx(-VALUES["roll_gain"] * slope)
    assert model.B[4, 0] == pytest.approx(-VALUES["yaw_gain"] * slope)
    assert sorted(eigenvalue.real for eigenvalue in model.eigenvalues) == pytest.approx([-0.0582] * 3 + [0.0] * 2)
    high = hover_model(body(), density=0.95)
    assert high.trim[0] > c
    with pytest.raises(MissingDataError, match=r"yaw_gain \(not flown\)"):
        hover_model(body(missing=("yaw_gain",)))


def test_files(tmp_path):
    files, findings = write_craft(body(), tmp_path, arm=0.35)
    assert [path.name for path in files] == ["craft.json", "craft.mat", "sitl_frame.json", "sitl_frame.md"]
    assert not findings
    numbers = json.loads(files[0].read_text())
    assert np.shape(numbers["hover"]["B"]) == (5, 8)
    matlab = loadmat(files[1], simplify_cells=True)
    assert matlab["parameters"]["thrust"]["value"] == pytest.approx(VALUES["thrust"])
    assert matlab["hover"]["A"].shape == (5, 5)
    assert json.loads(files[2].read_text())["num_motors"] == 8
    assert "`hoverThrOut`" in files[3].read_text()
    _, findings = write_craft(replace(body(missing=("roll_gain",)), mass=None), tmp_path)
    assert [f.id for f in findings] == ["not-determined", "not-determined"]
    assert findings[0].reason != findings[1].reason
