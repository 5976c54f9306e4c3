"""Drag below zero: a table of a windy flight said "Drag known, -0.23 ± 0.05 1/s"."""

from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof.signs import refuse_impossible


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
