"""`rotorid prove` says thin margins first, and ends with 1 where the change of gains is not to be flown."""

import pandas as pd
import pytest
from typer.testing import CliRunner

from rotorid.cli.main import app
from sysid.loops.proof import AS_PREDICTED, WORSE, Proof

LOG = "sample_logs/quad01_davos_esc.bin"


def proof(gain_db: float = 9.0, verdict: str = AS_PREDICTED, refused: str | None = None) -> Proof:
    index = pd.MultiIndex.from_tuples([("roll", "gain_db")], names=["axis", "quantity"])
    row = {"predicted": 9.0, "predicted_sigma": 0.3, "measured": gain_db, "measured_sigma": 0.2, "unit": "dB"}
    table = pd.DataFrame([row], index=index)
    return Proof(("a",), ("b",), table, verdict, refused, {"ATC_RAT_RLL_P": (0.1, 0.2)}, {}, {})


@pytest.mark.parametrize(
    ("found", "status", "first"),
    [
        (proof(), 0, "ATC_RAT_RLL_P "),
        (proof(1.2), 1, "THIN: roll has 1.2 dB of gain margin"),
        (proof(verdict=WORSE), 1, "ATC_RAT_RLL_P "),
        (proof(refused="another frame"), 1, "not comparable: another frame"),
    ],
)
def test_the_status_says_whether_to_fly_on(
    monkeypatch: pytest.MonkeyPatch, found: Proof, status: int, first: str
) -> None:
    monkeypatch.setattr("sysid.loops.proof.prove", lambda *_: found)
    monkeypatch.setattr("rotorid.cli.tune.open_log", lambda name: name)
    done = CliRunner().invoke(app, ["prove", LOG, LOG])
    assert (done.exit_code, done.output.startswith(first)) == (status, True), done.output
    assert (found.verdict in done.output) is (found.refused is None)
