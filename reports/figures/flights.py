"""The flights of a folder over time: how long each was, and whether anything happened."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

from pipeline.results.answer import Tone
from pipeline.results.report import FlightInShort
from reports.figures.figure import Figure, Trace, layout_of, plotly_text

_COLORS = {Tone.GOOD: "@good", Tone.CARE: "@care", Tone.BAD: "@bad", Tone.UNKNOWN: "@quiet"}
_MARKS = {Tone.GOOD: "circle", Tone.CARE: "diamond", Tone.BAD: "x", Tone.UNKNOWN: "circle-open"}
_NAMES = {Tone.GOOD: "nothing", Tone.CARE: "to look into", Tone.BAD: "in danger", Tone.UNKNOWN: "not known"}


def flights_over_time(flights: Sequence[FlightInShort]) -> Figure | None:
    """Draw the duration of each flight over its date, or over its place where dates are not known."""
    flown = [(each, each.flight) for each in flights if each.flight is not None]
    if len(flown) < 2:
        return None
    dated = all(each.log.start_utc for each, _ in flown)
    places = [str(k + 1) for k in range(len(flown))]
    if dated:
        # The log's clock is 0 at `start_utc`; several flights share it.
        places = [
            f"{datetime.fromisoformat(str(each.log.start_utc)) + timedelta(seconds=flight.start_s):%Y-%m-%d %H:%M:%S}"
            for each, flight in flown
        ]
    tones = [_tone(each) for each, _ in flown]
    data: list[Trace] = []
    for tone in _COLORS:
        chosen = [k for k, its in enumerate(tones) if its is tone]
        if chosen:
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": [places[k] for k in chosen],
                    "y": [round(flown[k][1].duration_s / 60.0, 2) for k in chosen],
                    "name": _NAMES[tone],
                    "text": [plotly_text(f"{flown[k][0].name}: {flown[k][0].happened}") for k in chosen],
                    "marker": {"color": _COLORS[tone], "symbol": _MARKS[tone], "size": 9},
                    "hovertemplate": "%{text}<br>%{y:.1f} min<extra></extra>",
                }
            )
    axis = {"title": {"text": "start (UTC)"}, "type": "date"} if dated else {"title": {"text": "flight"}}
    layout = layout_of(xaxis=axis, yaxis={"title": {"text": "duration (min)"}, "rangemode": "tozero"})
    return Figure("first-flights", "The flights over time.", data, layout, 330, time=False)


def _tone(flight: FlightInShort) -> Tone:
    lines = () if flight.answer is None else flight.answer.lines
    return next((each.tone for each in lines if each.purpose == "Happened"), Tone.UNKNOWN)
