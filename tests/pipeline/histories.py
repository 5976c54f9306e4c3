"""Histories of parameters over the flights of a craft, drawn with known drifts and steps."""

import dataclasses
from datetime import timedelta

import numpy as np

from tests.pipeline.builders import START, flown, stated

#: Parameters with a typical value, standard error of one flight and true scatter between flights.
CRAFT = {
    "thrust over mass": (8.5, 0.03, 0.10),
    "motor lag": (0.05, 0.004, 0.0),
    "yaw torque over inertia": (22.0, 0.8, 0.5),
    "linear drag over mass": (0.25, 0.05, 0.0),
}


def flights_of(values, unit="u", days=1.0):
    """Make flights from series: parameter -> [(value, sigma) per flight], on days one after the other."""
    count = len(next(iter(values.values())))
    return [
        dataclasses.replace(
            flown(f"f{k:02d}", start=START + timedelta(days=days * k)),
            parameters=tuple(stated(name, *v[k], unit) for name, v in values.items()),
        )
        for k in range(count)
    ]


def series(random, count, drift=None, step=None):
    """Draw each parameter of every flight; `drift` and `step` name a parameter and its change in its own unit."""
    values = {}
    for name, (value, sigma, between) in CRAFT.items():
        errors = sigma * random.uniform(0.6, 1.6, count)
        true = value + between * random.standard_normal(count)
        if drift and drift[0] == name:
            true = true + drift[1] * np.arange(count)
        if step and step[0] == name:
            true = true + step[1] * (np.arange(count) >= count // 2)
        values[name] = list(zip(true + errors * random.standard_normal(count), errors, strict=True))
    return values
