"""What a model holds is in its record, or is left out knowingly: nothing is missing from report.json by mistake."""

from dataclasses import fields
from typing import get_type_hints

import pytest

from sysid import (
    ClosedLoopModel,
    SixDofModel,
    TransferFunction,
    TransferFunctionModel,
    Validation,
)
from sysid.rigid_body.six_dof.model import SixDofReport
from sysid.transfer_functions.model_record import (
    ClosedLoopRecord,
    FunctionRecord,
    TransferFunctionsRecord,
)
from sysid.validation.report import ValidationReport


@pytest.mark.parametrize(
    ("kind", "record", "renamed", "left_out"),
    [
        # What training records started from serves their own plots alone.
        (TransferFunctionModel, TransferFunctionsRecord, {}, {"initial_states"}),
        (ClosedLoopModel, ClosedLoopRecord, {}, set()),
        (TransferFunction, FunctionRecord, {}, set()),
        # Free runs are arrays of the flight's length; `inside` is in `drift`.
        (Validation, ValidationReport, {}, {"predictions", "inside", "findings"}),
        (
            SixDofModel,
            SixDofReport,
            {"scales": "errors"},
            {"theta", "shape", "kinds", "observer", "attitude_given", "wind_sigma"},
        ),
    ],
)
def test_a_record_has_every_field(kind, record, renamed, left_out):
    held = {renamed.get(field.name, field.name) for field in fields(kind)}
    written = set(get_type_hints(record))
    assert held - written == left_out
