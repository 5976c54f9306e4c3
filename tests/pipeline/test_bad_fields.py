"""Messages that are missing, empty or hold text where numbers belong cost what rests on them, and nothing else."""

import numpy as np
import pytest

from logparse import read_log
from pipeline.flight.account import account_of_flight
from pipeline.flight.account.readings import Readings
from pipeline.flight.signals import flight_signals
from pipeline.results.span import Span

LOG = "sample_logs/octa01_zurich_calm.bin"
FLIGHT = Span(48.0, 90.0)


def spoilt(name, how):
    """Read the log with one of its messages spoilt."""
    log = read_log(LOG)
    rows = log.messages[name]
    kept = rows.iloc[: {"missing": 0, "one row": 1}.get(how, len(rows))]
    if how == "markup":
        kept = kept.astype(object).map(lambda _: "<b>n/a</b>")
    elif how == "no number":
        kept = kept.map(lambda cell: np.nan if isinstance(cell, int | float | np.number) else cell)
    log.messages.replace(name, kept)
    return log


#: Which plot rests on a message; each is spoilt in two of four ways.
PANELS = {
    **{"ATT": "attitude", "RATE": "rates", "VIBE": "vibration", "BAT": "battery", "GPS": "gps", "MAG": "compass"},
    **dict.fromkeys(("CTUN", "RCOU", "IMU", "PARM"), ""),
}
HOWS = ("missing", "one row", "markup", "no number")


@pytest.mark.parametrize(("name", "how"), [(name, how) for k, name in enumerate(PANELS) for how in HOWS[k % 2 :: 2]])
def test_a_spoilt_message_costs_its_own_plot_only(name, how):
    log = spoilt(name, how)
    signals, account = flight_signals(Readings.of(log, FLIGHT)), account_of_flight(log, FLIGHT)
    drawn = {signal for signal in ("attitude", "rates", "vibration", "battery", "gps") if getattr(signals, signal)}
    assert {"attitude", "rates", "vibration", "battery", "gps"} - drawn <= {PANELS[name]}
    assert account.story == ()
