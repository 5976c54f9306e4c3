"""Two reports of a craft against each other: what changed by more than flights differ anyway, and what did not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from typing import Literal

import scipy

from core.quantity import number
from pipeline.config import AnalysisConfig
from pipeline.fleet.meta_analysis import corrected, difference
from pipeline.names import printable
from pipeline.results.drift import ParameterChange
from pipeline.results.model import ModelReport, average
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from sysid.rigid_body.consensus import TRUSTED
from sysid.validation.uses import Trust

#: Settings of an analysis that do not change what is found.
_NO_MATTER = frozenset({"time_limit", "training", "validation"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """A report, by what it is called, and the version that wrote it."""

    report: str
    rotorid: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelError:
    """Held-out error of a model on a side, beside that of the mean, m."""

    rmse_m: float | None
    mean_m: float | None
    flights: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorChange:
    """Errors of a model on both sides, their ratio, and the chance of such a difference."""

    model: str
    title: str
    output: str
    a: ModelError
    b: ModelError
    ratio: float | None
    p: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictChange:
    """What a model is worth on both sides."""

    model: str
    title: str
    a: Trust
    b: Trust


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingChange:
    """A setting of the craft, or of the analysis, that differs."""

    of: str
    name: str
    a: object
    b: object


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What a side is of: its name, its flights, and when they were."""

    name: str
    flights: int
    first_utc: str | None
    last_utc: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedPair:
    """A craft, or a flight, before and after."""

    a: Facts
    b: Facts
    changed: tuple[SettingChange, ...]
    parameters: tuple[ParameterChange, ...]
    errors: tuple[ErrorChange, ...]
    verdicts: tuple[VerdictChange, ...]
    sentences: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unpaired:
    """What has no like on the other side."""

    a: tuple[str, ...]
    b: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportComparison:
    """Two reports craft by craft: what comparison.json holds."""

    kind: Literal["comparison"] = "comparison"
    rotorid: str
    a: Side
    b: Side
    pairs: tuple[ComparedPair, ...]
    unpaired: Unpaired


#: Value and sigma in each flight that determined a parameter, by parameter and method.
Points = dict[tuple[str, str], list[tuple[float, float]]]


@dataclass(frozen=True, slots=True)
class Compared:
    """What is compared: a craft over its flights, or one flight where there is no joint model."""

    name: str
    numbers: FlightReport | CraftReport
    config: AnalysisConfig
    flights: Sequence[FlightReport]
    points: Points
    units: Mapping[str, str]  #: By parameter.


def subjects(report: FlightReport | FleetReport) -> list[Compared]:
    """Find what a report can be compared by: its crafts; its one flight when it is the report of a flight."""
    if isinstance(report, FlightReport):
        return [_of_flight(report)]
    by_name = {flight.name: flight for flight in report.flights}
    return [_of_craft(craft, report.config, by_name) for craft in report.groups]


def _of_flight(flight: FlightReport) -> Compared:
    points: Points = {}
    for row in flight.parameters or ():
        # The other report is of another day.
        sigma = None if row.sigma is None else math.hypot(row.sigma, row.transfer or 0.0)
        if row.value is not None and sigma:
            points[row.parameter, row.method] = [(row.value, sigma)]
    units = {row.parameter: row.unit for row in flight.parameters or ()}
    return Compared(flight.name, flight, flight.config, [flight], points, units)


def _of_craft(craft: CraftReport, config: AnalysisConfig, by_name: Mapping[str, FlightReport]) -> Compared:
    flights = [by_name[name] for name in (*craft.training, *craft.held_out) if name in by_name]
    followed = () if craft.drift is None else craft.drift.parameters
    points: Points = {
        (history.parameter, method): [(point.value, point.sigma) for point in rows if point.sigma]
        for history in followed
        for method, rows in {history.method: history.flights, **history.others}.items()
    }
    return Compared(
        craft.name, craft, config, flights, points, {history.parameter: history.unit for history in followed}
    )


def compare_reports(
    a: FlightReport | FleetReport, b: FlightReport | FleetReport, names: tuple[str, str]
) -> ReportComparison:
    """Compare two reports craft by craft."""
    pairs, left, right = _pair(subjects(a), subjects(b))
    return ReportComparison(
        rotorid=version("rotorid"),
        a=Side(report=printable(names[0]), rotorid=a.rotorid),
        b=Side(report=printable(names[1]), rotorid=b.rotorid),
        pairs=tuple(_compare(before, after) for before, after in pairs),
        unpaired=Unpaired(a=tuple(compared.name for compared in left), b=tuple(compared.name for compared in right)),
    )


def _pair(
    a: Sequence[Compared], b: Sequence[Compared]
) -> tuple[list[tuple[Compared, Compared]], list[Compared], list[Compared]]:
    """Pair what is called alike, in order; what is alone on both sides is a pair whatever it is called."""
    pairs, left, right = [], [], list(b)
    for compared in a:
        match = next((other for other in right if other.name == compared.name), None)
        if match is None:
            left.append(compared)
        else:
            pairs.append((compared, match))
            right.remove(match)
    if len(left) == len(right) == 1:
        pairs.append((left.pop(), right.pop()))
    return pairs, left, right


def _compare(a: Compared, b: Compared) -> ComparedPair:
    parameters, changed = _parameters(a, b), tuple(_changed(a, b))
    after = {model.key: model for model in b.numbers.models}
    both = [(model, after[model.key]) for model in a.numbers.models if model.key in after]
    return ComparedPair(
        a=_facts(a),
        b=_facts(b),
        changed=changed,
        parameters=parameters,
        errors=tuple(row for pair in both for row in _errors(*pair)),
        verdicts=tuple(
            VerdictChange(model=model.key, title=model.title, a=model.verdict.trust, b=other.verdict.trust)
            for model, other in both
        ),
        sentences=tuple(_sentences(parameters, changed)),
    )


def _facts(subject: Compared) -> Facts:
    starts = sorted(flight.log.start_utc for flight in subject.flights if flight.log.start_utc)
    return Facts(
        name=subject.name,
        flights=len(subject.flights),
        first_utc=starts[0] if starts else None,
        last_utc=starts[-1] if starts else None,
    )


def _parameters(a: Compared, b: Compared) -> tuple[ParameterChange, ...]:
    """Test every parameter that both sides determined, by the first of the trusted methods that both have."""
    rows: list[ParameterChange] = []
    for parameter in dict.fromkeys(name for name, _ in a.points):
        keys = [(parameter, method) for method in TRUSTED]
        pair = next((pair for pair in keys if a.points.get(pair) and b.points.get(pair)), None)
        if pair is not None:
            rows.append(difference(*pair, a.units[parameter], a.points[pair], b.points[pair]))
    return corrected(rows)


def _errors(model: ModelReport, other: ModelReport) -> Iterator[ErrorChange]:
    """Set held-out errors of a model on both sides beside each other, output by output."""
    if not (model.held_out and other.held_out):
        return
    means = [average([row.rmse_mean_m for row in side.held_out]) for side in (model, other)]
    for output, error in model.rmse_average_m.items():
        left, right = ([row.rmse_m[output] for row in side.held_out] for side in (model, other))
        later = other.rmse_average_m[output]
        yield ErrorChange(
            model=model.key,
            title=model.title,
            output=output,
            a=ModelError(rmse_m=error, mean_m=means[0][output], flights=len(left)),
            b=ModelError(rmse_m=later, mean_m=means[1][output], flights=len(right)),
            ratio=later / error if error and later else None,
            p=_different(left, right),
        )


def _different(a: Sequence[float | None], b: Sequence[float | None]) -> float | None:
    """Chance of errors as different as these (Welch's t of their logarithms); None with too few flights."""
    left, right = ([math.log(value) for value in values if value] for values in (a, b))
    # Flights on each side from which on errors of models are tested and not only set side by side.
    if min(len(left), len(right)) < 3:
        return None
    return float(scipy.stats.ttest_ind(left, right, equal_var=False).pvalue)


def _changed(a: Compared, b: Compared) -> list[SettingChange]:
    """List what differs of the craft and of the settings of the analysis: a change of parameters may come from it."""
    return [
        SettingChange(of=of, name=field.name, a=left, b=right)
        for of, before, after in (
            ("craft", a.numbers.vehicle, b.numbers.vehicle),
            ("analysis", a.config, b.config),
        )
        for field in fields(before)
        if field.name not in _NO_MATTER
        and (left := getattr(before, field.name)) != (right := getattr(after, field.name))
    ]


def _sentences(parameters: Sequence[ParameterChange], changed: Sequence[SettingChange]) -> list[str]:
    """Report what changed, what did not as far as can be seen, and what these flights cannot tell."""
    if not parameters:
        return [
            "No parameter is determined on both sides, so none can be compared; the reports say why "
            "(“not determined”) and how to fly for them."
        ]
    text = []
    moved = [row for row in parameters if row.significant]
    if moved:
        what = "; ".join(f"{row.parameter} {row.written}" for row in moved)
        text.append(f"Changed, of {len(parameters)} parameters compared: {what}.")
    else:
        text.append(f"None of the {len(parameters)} parameters compared changed by more than chance explains.")
    still = [row for row in parameters if not row.significant and row.detectable_percent is not None]
    if still:
        least = ", ".join(f"{row.parameter} {number(row.detectable_percent, 2)} %" for row in still)
        text.append(f"Where no change is seen, one smaller than this would hardly have been found: {least}.")
    alone = [row.parameter for row in parameters if row.between_flights is None]
    if alone:
        text.append(
            f"With one flight on each side that tells it ({', '.join(alone)}) nobody knows how much flights differ "
            "anyway; wind, battery and temperature alone move parameters. Analyse several flights before and after."
        )
    elif any(min(row.a.flights, row.b.flights) < 3 for row in still):
        text.append(
            "So few flights can hardly tell a change from how flights differ anyway; analyse three or more on each "
            "side."
        )
    if any(change.of == "craft" for change in changed):
        text.append("The craft itself was set differently; the table of settings says how.")
    if any(change.of == "analysis" for change in changed):
        text.append("The two analyses had different settings, which may make a difference of their own.")
    return text
