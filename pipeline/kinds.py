"""The kinds of models of a motion that an analysis fits side by side, in the order in which reports show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sysid
from pipeline.config import AnalysisConfig
from pipeline.stages import Progress

#: Part of the time limit of a stage after which a fit gives the best model so far instead of being given up.
FIT_PART = 0.5

#: The kind whose experiments thrust coefficients are fitted to.
THRUST_KEY = "motors"

Fit = Callable[[Sequence[sysid.Experiment], AnalysisConfig, Progress], sysid.Model]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of model.

    Attributes
    ----------
    key : str
        Names it in files.
    title : str
        Names it for people.
    inputs, frame : str
        Inputs of its experiments and their frame, as `Experiment.from_flight` takes them.
    fit : callable
        ``fit(experiments, config, progress)``.
    scans : bool
        Whether its number of poles and zeros can be scanned.
    """

    key: str
    title: str
    inputs: str
    frame: str
    fit: Fit
    scans: bool = True


def _transfer_functions(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.TransferFunctionModel:
    return sysid.fit_transfer_functions(
        experiments,
        poles=config.poles,
        zeros=config.zeros,
        structure=config.structure,
        time_limit=FIT_PART * config.time_limit,
        progress=progress,
    )


def _closed_loop(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.ClosedLoopModel:
    # One of the zeros belongs to integral action: there is no closed loop without it.
    zeros = max(config.zeros, 1)
    return sysid.fit_closed_loop(
        experiments,
        poles=max(config.poles, zeros + 1),
        zeros=zeros,
        time_limit=FIT_PART * config.time_limit,
        progress=progress,
    )


KINDS = (
    Kind("motors", "motor PWM → position", "motors", "earth", _transfer_functions),
    Kind("mixer", "mixer commands → position", "mixer", "heading", _transfer_functions),
    Kind("reference", "position asked for → position (closed loop)", "reference", "earth", _closed_loop, scans=False),
)
