"""Firmware before and after a change of gains: predictions hold; nothing is taken from a chirp at its limits."""

import numpy as np
import pytest

from logparse import read_log
from sysid.loops import prove


@pytest.fixture(scope="module")
def flown(unpacked):
    return lambda name: read_log(unpacked(f"pairs/{name}"))


@pytest.mark.slow
def test_a_level_crossover_is_foretold_within_its_error_and_said_to_be_level(flown):
    """Straight from its chirp the later loop was 11 % off the prediction: PID rows of every fourth loop bend it."""
    proof = prove(flown("octa3_id"), flown("octa3_g2"))
    row = proof.table.loc[("pitch", "crossover_hz")]
    assert abs(row["predicted"] / row["measured"] - 1.0) < 0.06
    assert abs(row["predicted"] - row["measured"]) < 2.0 * np.hypot(row["predicted_sigma"], row["measured_sigma"])
    assert any("level" in remark for remark in proof.remarks)


@pytest.mark.slow
def test_nothing_is_measured_from_a_chirp_at_its_limits(flown):
    """Gains at which the craft oscillates keep the mixer at its limits for three quarters of the chirp."""
    proof = prove(flown("quad15_id"), flown("quad15_hot"))
    assert proof.verdict.startswith("worse")
    assert proof.table["measured"].isna().all()
    assert proof.table.loc[("roll", "phase_deg"), "predicted"] < 0.0
    assert any("76 %" in remark for remark in proof.remarks)
