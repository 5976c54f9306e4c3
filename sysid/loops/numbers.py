"""Tunings and proofs as numbers for JSON: what pages and scripts read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from logparse.serialization import plain
from sysid.loops.loop import MARGINS, Margins, RateLoop
from sysid.loops.proof import Proof
from sysid.loops.responses import attitude_bandwidth
from sysid.loops.tuning import AxisTuning, Tuning

Numbers = dict[str, Any]

#: Frequencies and draws of the response that a page gets.
_POINTS, _DRAWS = 180, 40


def margins_numbers(margins: Margins) -> Numbers:
    """Lay out margins with errors and 95 % intervals."""
    result: Numbers = {"stable": margins.stable, "unstable_part": margins.unstable}
    for name in MARGINS:
        estimate = getattr(margins, name)
        interval = margins.intervals.get(name)
        result[name] = plain(estimate) | {"interval95": list(interval) if interval else None}
    return result


def loop_numbers(loop: RateLoop) -> Numbers:
    """Lay out a loop: settings, margins and the craft's response with draws of its error."""
    rows = np.unique(np.linspace(0, len(loop.hz) - 1, _POINTS).round().astype(int))
    plant = loop.plant.response / loop.flown.gyro.response(loop.hz)
    draws = loop.plant.draws[1 : _DRAWS + 1, rows] / loop.plant.response[rows]
    notches = np.ones(len(loop.hz), np.complex128)
    for one in loop.flown.gyro.notches:
        notches *= one.response(loop.hz)
    controller = loop.settings.controller
    return {
        "axis": loop.axis,
        "logs": loop.name,
        "parameters": loop.settings.parameters(),
        "loop_rate_hz": controller.loop_rate,
        "gyro_rate_hz": loop.settings.gyro.rate,
        "margins": margins_numbers(loop.margins),
        "attitude_bandwidth_hz": _finite(attitude_bandwidth(loop)),
        "response": {
            "hz": loop.hz[rows].tolist(),
            "real": (plant * notches)[rows].real.tolist(),
            "imag": (plant * notches)[rows].imag.tolist(),
            "notch_real": notches[rows].real.tolist(),
            "notch_imag": notches[rows].imag.tolist(),
            "coherence": loop.plant.coherence_at(loop.hz[rows]).tolist(),
            "draws_gain": np.log(np.abs(draws)).tolist(),
            "draws_phase": np.angle(draws).tolist(),
        },
    }


def tuning_numbers(tuning: Tuning) -> Numbers:
    """Lay out a tuning."""
    aim = tuning.aim
    return {
        "kind": "tuning",
        "logs": list(tuning.logs),
        "made": tuning.made,
        "aim": {"gain_db": aim.gain_db, "phase_deg": aim.phase_deg, "peak_db": aim.peak_db, "noise": aim.noise},
        "refused": tuning.refused,
        "proposed": tuning.proposed,
        "rollback": tuning.rollback,
        "remarks": list(tuning.remarks),
        "axes": [_axis_numbers(axis) for axis in tuning.axes],
    }


def _axis_numbers(axis: AxisTuning) -> Numbers:
    return {
        "axis": axis.axis,
        "refused": axis.refused,
        "flown": loop_numbers(axis.loop) if axis.loop is not None else None,
        "measured_margins": (
            margins_numbers(axis.loop.measured_margins)
            if axis.loop is not None and axis.loop.measured is not None
            else None
        ),
        "tuned": (
            {"parameters": axis.tuned.settings.parameters(), "margins": margins_numbers(axis.tuned.margins)}
            if axis.tuned is not None
            else None
        ),
        "worst_of_95": dict(axis.worst),
        "actuator_noise_factor": axis.noise,
    }


def proof_numbers(proof: Proof) -> Numbers:
    """Lay out a proof."""
    rows = [
        {str(name): _finite(value) if isinstance(value, float) else value for name, value in row.items()}
        for row in proof.table.reset_index().to_dict("records")
    ]
    return {
        "kind": "proof",
        "before": list(proof.before),
        "after": list(proof.after),
        "refused": proof.refused,
        "verdict": proof.verdict,
        "changed": {name: list(pair) for name, pair in proof.changed.items()},
        "changed_beyond_the_loops": {name: list(pair) for name, pair in proof.beyond.items()},
        "table": rows if proof.refused is None else [],
        "remarks": list(proof.remarks),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
