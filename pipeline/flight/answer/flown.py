"""How long, how high, how far and how fast the craft flew."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from core.quantity import duration, uncertain
from pipeline.flight.answer.words import brief
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult


def flown(result: FlightResult) -> AnswerLine:
    """Answer how long, how high, how far and how fast; heights and distances are from where it began."""
    flight, trajectory = result.flight, result.trajectory
    if isinstance(flight, Failure):
        why = flight.reason.removeprefix("The log shows no flight: ")
        return AnswerLine(purpose="Flown", word="no", tone=Tone.UNKNOWN, text=brief(why))
    rows = None if isinstance(trajectory, Failure) else trajectory.states.loc[flight.start : flight.stop]
    if isinstance(trajectory, Failure) or rows is None or not len(rows) or trajectory.inconsistency:
        known = not isinstance(trajectory, Failure) and rows is not None and len(rows) > 0
        why = "sensors disagree" if known else "its course is not known"
        return AnswerLine(purpose="Flown", word=duration(flight.duration), tone=Tone.UNKNOWN, text=why)
    sigma = trajectory.sigma.loc[rows.index]
    high = int(rows["p_d"].to_numpy().argmin())
    climb = float(rows["p_d"].iloc[0] - rows["p_d"].iloc[high])
    text = "high"
    if result.position_known:
        north, east = rows["p_n"].to_numpy(np.float64), rows["p_e"].to_numpy(np.float64)
        away = np.hypot(north - north[0], east - east[0])
        far = int(away.argmax())
        speed = np.linalg.norm(rows[["v_n", "v_e", "v_d"]].to_numpy(np.float64), axis=1)
        fast = int(speed.argmax())
        text += f", {uncertain(float(away[far]), _largest(sigma, ('p_n', 'p_e'), far), 'm')} away"
        text += f", up to {uncertain(float(speed[fast]), _largest(sigma, ('v_n', 'v_e', 'v_d'), fast), 'm/s')}"
    return AnswerLine(
        purpose="Flown",
        word=duration(flight.duration),
        tone=Tone.GOOD,
        text=text,
        value=climb,
        sigma=_largest(sigma, ("p_d",), high),
        unit="m",
    )


def _largest(sigma: pd.DataFrame, columns: Sequence[str], row: int) -> float:
    """Return the sigma of a difference from the first row, at most: the errors of both rows count, whichever way."""
    return math.hypot(*(float(sigma[column].iloc[each]) for column in columns for each in (0, row)))
