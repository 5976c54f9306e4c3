"""What pages say of parameters over flights: value, scatter, trend, and whether any of it is more than chance."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import number, per_degree, uncertain, with_unit
from core.table import Row, Table
from pipeline.results.drift import Drift, ParameterChange
from reports.views import log_words


def drift_table(drift: Drift | None) -> Table | None:
    """Tabulate each parameter over the flights, those that change first."""
    if drift is None or not drift.parameters:
        return None
    rows = []
    for each in sorted(drift.parameters, key=lambda each: each.change is None):
        degrees, unit = per_degree(each.unit.partition(",")[0])
        trend, step = each.trend, each.step
        cells = [
            str(len(each.flights)),
            _written(each.mean, each.mean_sigma, degrees),
            number(each.between * degrees, 2),
            "–" if trend is None else _written(trend.per_flight, trend.per_flight_sigma, degrees),
            "–" if trend is None else chance(trend.p_adjusted),
            "–" if step is None else _written(step.change, step.sigma, degrees),
            "–" if step is None else chance(step.p_adjusted),
        ]
        label = with_unit(f"{each.parameter[:1].upper()}{each.parameter[1:]}, {each.method}", unit)
        rows.append(Row(label, cells, "" if each.change is None else "strong"))
    return Table(
        label="Parameter",
        heads=["flights", "mean", "scatter", "trend per flight", "p", "step", "p"],
        rows=rows,
        caption="Mean over flights with one standard error, scatter between flights beyond their own errors, trend "
        "per flight and change at once between two flights, each with the chance of it where nothing changes, "
        "corrected for the number of questions asked.",
    )


def drift_sentences(drift: Drift | None) -> list[str]:
    """Report what changes over the flights, the gravest first; of what does not, only that."""
    if drift is None:
        return []
    motors = drift.motors
    about_motors = [] if motors is None else [motors.sentence]
    said = [each.sentence for each in drift.parameters if each.change is not None]
    said = [*about_motors, *said] if motors is not None and motors.weakening else [*said, *about_motors]
    steady = sum(each.change is None for each in drift.parameters)
    if steady and steady == len(drift.parameters):
        said.append(f"None of the {steady} parameters followed over {len(drift.flights)} flights is seen to change")
    return [log_words.sentence(each) for each in said if each]


def _written(value: float, sigma: float, factor: float) -> str:
    return uncertain(factor * value, factor * sigma)


def chance(p: float | None) -> str:
    """Write a probability: three digits are more than anybody needs."""
    if p is None:
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def change_table(changes: Sequence[ParameterChange]) -> Table:
    """Lay parameters out: before, after, difference, and whether it is more than chance."""
    rows = []
    for each in changes:
        degrees, unit = per_degree(each.unit.partition(",")[0])
        cells = [_written(side.value, side.sigma, degrees) for side in (each.a, each.b)]
        percent = each.difference_percent is not None
        cells.append(each.written if percent else _written(each.difference, each.difference_sigma, degrees))
        label = with_unit(f"{each.parameter[:1].upper()}{each.parameter[1:]}, {each.method}", unit)
        cells += [chance(each.p_adjusted), "changed" if each.significant else "no change seen"]
        rows.append(Row(label, cells, "strong" if each.significant else ""))
    return Table(
        label="Parameter",
        heads=["before", "after", "difference", "p", "verdict"],
        rows=rows,
        caption="Means over the flights of each side with one standard error, which holds how much flights differ. "
        "p is the chance of such a difference when nothing changed, corrected for the number of parameters.",
    )
