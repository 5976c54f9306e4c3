"""Firmware before and after a change of gains: predictions hold; nothing is taken from a chirp at its limits."""

import numpy as np
import pytest

from sysid.loops import prove


@pytest.fixture(scope="module")
def hot(flown):
    """Prove the gains at which the firmware craft oscillated: 1.5 times P, I and D."""
    return prove(flown("quad15_id"), flown("quad15_hot"))


@pytest.mark.slow
def test_a_level_crossover_is_foretold_within_its_error_and_said_to_be_level(flown):
    """Straight from its chirp the later loop was 11 % off the prediction: PID rows of every fourth loop bend it."""
    proof = prove(flown("octa3_id"), flown("octa3_g2"))
    row = proof.table.loc[("pitch", "crossover_hz")]
    assert abs(row["predicted"] / row["measured"] - 1.0) < 0.06
    assert abs(row["predicted"] - row["measured"]) < 2.0 * np.hypot(row["predicted_sigma"], row["measured_sigma"])
    assert any("level" in remark for remark in proof.remarks)


@pytest.mark.slow
def test_nothing_is_measured_from_a_chirp_at_its_limits(hot):
    """Gains at which the craft oscillates keep the mixer at its limits for three quarters of the chirp."""
    assert hot.verdict == "worse: restore rollback.param"
    assert hot.table["measured"].isna().all()
    assert hot.table.loc[("roll", "phase_deg"), "predicted"] < 0.0
    assert any("76 %" in remark for remark in hot.remarks)


@pytest.mark.slow
def test_gains_at_which_it_oscillated_are_called_unstable_from_the_flight_before(hot):
    """Flight quad15_id alone says that it would."""
    for predicted, _ in hot.loops.values():
        assert not predicted.margins.stable
        assert predicted.margins.unstable > 0.95


@pytest.mark.slow
def test_prediction_of_a_firmware_flight_with_other_gains(flown):
    proof = prove(flown("octa3_id"), flown("octa3_g1"))
    assert proof.verdict == "as predicted"
    for axis in ("roll", "pitch"):
        row = proof.table.loc[axis]
        assert row.loc["crossover_hz", "predicted"] == pytest.approx(row.loc["crossover_hz", "measured"], rel=0.05)
        assert row.loc["phase_deg", "predicted"] == pytest.approx(row.loc["phase_deg", "measured"], abs=6.0)
        assert row.loc["gain_db", "predicted"] == pytest.approx(row.loc["gain_db", "measured"], abs=1.0)
        assert row.loc["rejection_hz", "predicted"] == pytest.approx(row.loc["rejection_hz", "measured"], rel=0.1)
        assert row.loc["step_fit", "predicted"] >= 90.0


@pytest.mark.parametrize("other", ["octa3_g1", "quadslow_g1"])
def test_logs_of_two_craft_are_a_sentence_and_no_numbers(flown, other):
    proof = prove(flown("quad15_id"), flown(other))
    assert "two craft" in proof.refused
    assert len(proof.table) == 0
