"""The kinds of models of a motion that an analysis fits side by side, in the order in which reports show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import sysid
from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Progress

#: Part of the time limit of a stage after which a fit gives the best model so far instead of being given up.
FIT_PART = 0.5

#: The kind whose experiments thrust coefficients are fitted to.
THRUST_KEY = "motors"

#: The kind whose experiments all physical methods are applied to.
RIGID_BODY_KEY = "rigid_body"


class Fit(Protocol):
    """Fits a kind of model to records."""

    def __call__(
        self,
        experiments: Sequence[sysid.Experiment],
        config: AnalysisConfig,
        progress: Progress,
        /,
    ) -> sysid.Model:
        """Fit one model to all records."""


@dataclass(frozen=True, slots=True)
class ModelKind:
    """One kind of model."""

    key: str  #: Names it in files.
    title: str  #: Names it for people.
    #: Inputs of its experiments and their frame, as `Experiment.from_flight` takes them.
    inputs: str
    frame: str
    fit: Fit  #: ``fit(experiments, config, progress)``.
    note: str  #: What the model describes, and what it cannot tell, for people who have to choose.
    scans: str = ""  #: Structure with which its number of poles and zeros can be scanned; empty when it cannot.
    rate: float | None = None  #: Samples per second that it needs; those of the configuration when None.
    #: Its outputs are a linear answer to its inputs, so that their coherence tells what it can know.
    linear: bool = True


def _motors(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.TransferFunctionModel:
    return _black_box(experiments, config, "per_input", progress)


def _mixer(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.TransferFunctionModel:
    # One craft answers to all commands, with the same modes.
    return _black_box(experiments, config, "common", progress)


def _black_box(
    experiments: Sequence[sysid.Experiment],
    config: AnalysisConfig,
    structure: str,
    progress: Progress,
) -> sysid.TransferFunctionModel:
    return sysid.fit_transfer_functions(
        experiments,
        poles=config.poles,
        zeros=config.zeros,
        structure=structure,
        time_limit=FIT_PART * config.time_limit,
        progress=progress,
    )


def _closed_loop(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.ClosedLoopModel:
    # The order is that of the position controller with drag, whatever is asked of the black boxes.
    return sysid.fit_closed_loop(experiments, time_limit=FIT_PART * config.time_limit, progress=progress)


def _rigid_body(
    experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
) -> sysid.RigidBodyModel:
    # Its paths are followed where it is fitted.
    return sysid.fit_rigid_body(
        experiments, mass=config.mass, time_limit=FIT_PART * config.time_limit, progress=progress
    )


KINDS = (
    ModelKind(
        "motors",
        "motor PWM → position",
        "motors",
        "earth",
        _motors,
        "A black box with a transfer function for every motor, as in Elhesasy 2024.",
        scans="per_input",
    ),
    ModelKind(
        "mixer",
        "mixer commands → position",
        "mixer",
        "heading",
        _mixer,
        "A black box from the thrust, tilt and yaw that the motors’ commands amount to, with one denominator for each "
        "axis: fewer coefficients.",
        scans="common",
    ),
    ModelKind(
        "reference",
        "position target → position",
        "reference",
        "earth",
        _closed_loop,
        "Craft and autopilot together: where the craft goes when it is told to, nothing of the craft alone.",
    ),
    ModelKind(
        RIGID_BODY_KEY,
        "rigid body",
        "motors",
        "earth",
        _rigid_body,
        "Physics: position from motor PWM and measured attitude, with thrust, drag and the wind of each flight.",
        rate=50.0,
        linear=False,
    ),
)
