"""What the loops' commands say of their numbers: a thin margin stays thin although it was foretold."""

import numpy as np
import pandas as pd

from sysid.loops.design import RELATIVE, Expected
from sysid.loops.proof import AS_PREDICTED, Proof


def _proof(rows: dict[tuple[str, str], float]) -> Proof:
    index = pd.MultiIndex.from_tuples(list(rows), names=["axis", "quantity"])
    table = pd.DataFrame({"predicted": list(rows.values()), "measured": list(rows.values())}, index=index)
    return Proof(("a.bin",), ("b.bin",), table, AS_PREDICTED, None, {}, {}, {})


def test_thin_margins_are_named_by_axis():
    rows = {
        ("roll", "gain_db"): 1.3,
        ("roll", "phase_deg"): 8.6,
        ("pitch", "gain_db"): 9.0,
        ("pitch", "phase_deg"): 30.0,
        ("yaw", "gain_db"): np.nan,
        ("yaw", "phase_deg"): 50.0,
    }
    assert _proof(rows).thin == {
        "roll": "1.3 dB of gain margin and 8.6 deg of phase margin",
        "pitch": "30 deg of phase margin",
    }


def test_expected_errors_that_are_shares_read_as_percent():
    assert str(Expected("roll gain", 0.00013, RELATIVE)) == "roll gain: 0.013 %"
    assert str(Expected("roll delay", 0.0021, "s")) == "roll delay: 0.0021 s"
    both = Expected("roll delay", 0.0021, "s", 2e-5)
    assert str(both) == "roll delay: 0.0021 s (repeated flights scatter by 2e-05 s)"
