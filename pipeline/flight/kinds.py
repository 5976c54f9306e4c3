"""The kinds of models of a motion that an analysis fits side by side, in the order in which reports show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sysid
from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Progress

#: Part of the time limit of a stage after which a fit gives the best model so far instead of being given up.
FIT_PART = 0.5

#: The kind whose experiments thrust coefficients are fitted to.
THRUST_KEY = "motors"

#: The kind whose experiments all physical methods are applied to.
RIGID_BODY_KEY = "rigid_body"


@dataclass(frozen=True, slots=True)
class ModelKind:
    """One kind of model."""

    key: str  #: Names it in files.
    title: str  #: Names it for people.
    #: Inputs of its experiments and their frame, as `Experiment.from_flight` takes them.
    inputs: str
    frame: str
    note: str  #: What the model describes, and what it cannot tell, for people who have to choose.
    structure: str = ""  #: Of a black box, whose number of poles and zeros can be scanned.
    rate: float | None = None  #: Samples per second that it needs; those of the configuration when None.
    #: Its outputs are a linear answer to its inputs, so that their coherence tells what it can know.
    linear: bool = True

    def fit(
        self, experiments: Sequence[sysid.Experiment], config: AnalysisConfig, progress: Progress
    ) -> sysid.TransferFunctionModel | sysid.ClosedLoopModel | sysid.RigidBodyModel:
        """Fit one model to all records."""
        limit = FIT_PART * config.time_limit
        if self.structure:
            return sysid.fit_transfer_functions(
                experiments,
                poles=config.poles,
                zeros=config.zeros,
                structure=self.structure,
                time_limit=limit,
                progress=progress,
            )
        if self.linear:
            # The order is that of the position controller with drag, whatever is asked of the black boxes.
            return sysid.fit_closed_loop(experiments, time_limit=limit, progress=progress)
        return sysid.fit_rigid_body(experiments, mass=config.mass, time_limit=limit, progress=progress)


KINDS = (
    ModelKind(
        "motors",
        "motor PWM → position",
        "motors",
        "earth",
        "A black box with a transfer function for every motor, as in Elhesasy 2024.",
        structure="per_input",
    ),
    ModelKind(
        "mixer",
        "mixer commands → position",
        "mixer",
        "heading",
        "A black box from the thrust, tilt and yaw that the motors’ commands amount to, with one denominator for each "
        "axis: fewer coefficients.",
        structure="common",  # one craft answers to all commands, with the same modes
    ),
    ModelKind(
        "reference",
        "position target → position",
        "reference",
        "earth",
        "Craft and autopilot together: where the craft goes when it is told to, nothing of the craft alone.",
    ),
    ModelKind(
        RIGID_BODY_KEY,
        "rigid body",
        "motors",
        "earth",
        "Physics: position from motor PWM and measured attitude, with thrust, drag and the wind of each flight.",
        rate=50.0,
        linear=False,
    ),
)
