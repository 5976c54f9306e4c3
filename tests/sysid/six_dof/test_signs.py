"""Drag below zero: a table of a windy flight said "Drag known, -0.23 ± 0.05 1/s"; and gains below zero."""

import pytest

from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof.signs import refuse_impossible, wrong_turns


def known(**values):
    return {
        name: BodyParameter(name, "1/s", value, sigma, True, "", value, 2.0 * value, 2.0 * sigma, "N s/m")
        for name, (value, sigma) in values.items()
    }


def test_drag_that_pushes_is_not_determined_nor_what_leans_on_it():
    found = refuse_impossible(
        known(drag_rotor_x=(-0.23, 0.05), drag_quadratic_x=(0.09, 0.01), drag_rotor_y=(0.3, 0.05), thrust=(9.8, 0.1))
    )
    assert not found["drag_rotor_x"].determined
    assert "-0.23 ± 0.05" in found["drag_rotor_x"].reason
    assert (found["drag_rotor_x"].value, found["drag_rotor_x"].si_value) == (None, None)
    assert found["drag_rotor_x"].used == -0.23  # what the model flies with
    assert not found["drag_quadratic_x"].determined
    assert found["drag_rotor_y"].determined
    assert found["thrust"].determined


def test_drag_about_zero_stays():
    assert refuse_impossible(known(drag_rotor_x=(-0.05, 0.05)))["drag_rotor_x"].determined
    assert not refuse_impossible(known(roll_damping=(-3.0, 0.5)))["roll_damping"].determined


@pytest.mark.parametrize(("value", "severity"), [(-5.5, None), (-13.0, "warning"), (5.0, None)])
def test_a_gain_below_zero_by_chance_is_no_wrong_turn(value, severity):
    """A tail-sitter that its elevons pitch, with the motors as they are: -5.5 +- 4.6 rad/s^2 was warned of."""
    gains = {
        f"{axis}_gain": BodyParameter(f"{axis}_gain", "rad/s^2", None, None, False, "unsure", used)
        for axis, used in (("roll", 80.0), ("pitch", value), ("yaw", 10.0))
    }
    found = wrong_turns(gains, dict.fromkeys(gains, 4.6))
    assert [(each.id, str(each.severity)) for each in found] == ([("motor-order", severity)] if severity else [])


def test_a_gain_below_zero_that_is_determined_is_an_error():
    gains = known(roll_gain=(80.0, 2.0), pitch_gain=(-90.0, 2.0), yaw_gain=(10.0, 1.0))
    [found] = wrong_turns(gains, dict.fromkeys(gains, 2.0))
    assert (str(found.severity), dict(found.evidence)) == ("error", {"pitch": -90.0})
