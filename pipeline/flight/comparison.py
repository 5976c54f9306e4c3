"""Physical parameters of a craft by every method, from the same records as its models."""

from __future__ import annotations

from collections.abc import Sequence

import sysid
from logparse import MissingDataError
from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Stages
from pipeline.flight.kinds import RIGID_BODY_KEY
from pipeline.results.failure import Failure
from pipeline.results.flight import ModelResult


def compare_parameters(
    records: Sequence[sysid.Experiment], models: Sequence[ModelResult], config: AnalysisConfig, stages: Stages
) -> sysid.PhysicalParameters | Failure:
    """Apply every method to the records that the rigid body was fitted to."""
    result = next((each for each in models if each.key == RIGID_BODY_KEY), None)
    body = None if result is None else result.model

    def compare(_: object) -> sysid.PhysicalParameters:
        if not records:
            raise MissingDataError((result.missing if result else "") or "no record has motor outputs and attitude")
        return sysid.physical_parameters(
            records, config.mass, rigid_body=body if isinstance(body, sysid.RigidBodyModel) else None
        )

    return stages.run("parameters", compare)
