"""Guntur 2019: the blade-element rotor and the craft that flies on it."""

import math

import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from simulation import guntur2019
from simulation.guntur2019 import MOTORS, PAYLOADS

ROTOR = guntur2019.rotor()


def blade_thrust(v, speed, across, sinking, density=1.225):
    """Thrust by integrating lift along the blade, averaged over a turn: the printed formula before its integration.

    Pitch angle th0 + th1 r/R; perpendicular flow small against the tangential one, which in forward flight is
    ``w r + U sin(psi)``, whose square averages to ``(w r)^2 + U^2 / 2``.
    """
    R, chord, blades, slope = 0.102, 0.0274, 2, 5.7
    angle = math.atan2(0.1016, 2.0 * math.pi * 0.75 * R)

    def element(r):
        theta = 2.0 * angle - 4.0 / 3.0 * angle * r / R
        tangential = speed * r
        return (
            0.5
            * density
            * slope
            * blades
            * chord
            * (theta * (tangential**2 + 0.5 * across**2) + (sinking - v) * tangential)
        )

    return quad(element, 0.0, R, epsabs=1e-12)[0]


@pytest.mark.parametrize("across", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("sinking", [-6.0, -1.0, 0.0, 1.5])
@pytest.mark.parametrize("speed", [300.0, 700.0, 1500.0])
def test_solution_balances_blade_elements_and_momentum(speed, across, sinking):
    """Against an outside root finder on the two sides written anew, the blade side by numerical integration."""
    area = math.pi * 0.102**2

    def residual(v):
        momentum = 2.0 * v * 1.225 * area * math.sqrt(across**2 + (sinking - v) ** 2)
        return momentum - blade_thrust(v, speed, across, sinking)

    v = brentq(residual, -60.0, 60.0, xtol=1e-13)
    assert ROTOR.induced_velocity(speed, across=across, sinking=sinking) == pytest.approx(v, rel=1e-8)
    assert ROTOR.thrust(speed, across=across, sinking=sinking) == pytest.approx(
        blade_thrust(v, speed, across, sinking), rel=1e-8
    )


def test_feasibility_of_five_motors_with_three_cells():
    """KV 740 and 750 turn too slowly for three quarters of the tank or more at 11.1 V; power limits nobody."""
    table = guntur2019.feasibility()
    assert len(table) == len(MOTORS) * len(PAYLOADS)
    failed = table[~table["feasible"]]
    assert set(zip(failed["motor"], failed["payload"], strict=True)) == {
        (name, payload) for name in ("MT-4006-13 740KV", "AX-2810Q-750KV") for payload in (1.0, 0.75)
    }
    assert (table["power"] < table["limit_power"]).all()
    assert table["hover_rpm"].between(6000, 9300).all()
