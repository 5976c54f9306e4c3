"""Simulated flights by one call."""

import simulation


def simulate(case: str, **settings: object) -> simulation.CaseOutcome:
    """Fly a simulated craft with known truth.

    Parameters
    ----------
    case : str
        Such as ``"motion-wind"``; ``rotorid simulate --list`` has all.
    **settings
        Of the case, such as ``wind=3``.

    Returns
    -------
    CaseOutcome

    Raises
    ------
    ParameterError
        No case or setting is called so, or a value cannot be.
    """
    return simulation.find(case)[0].run(settings)
