"""Flights of which only the steady trims are known."""

from sysid.rotors.steady_trims import SteadyTrims

#: Trims of three flights of a real log.
REAL = ((-0.148, -0.035, -0.276), (-0.118, -0.017, -0.209), (-0.174, -0.109, -0.209))


def trimmed(*trims, variance=(4e-4, 7e-4, 2e-3)):
    """Return flights of a quad x with these trims; motor k takes half of each when it gives nothing."""
    rows = ((-0.5, 0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, -0.5), (-0.5, -0.5, -0.5))
    return [SteadyTrims(("m1", "m2", "m3", "m4"), trim, variance, rows) for trim in trims]
