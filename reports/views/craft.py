"""What the page on all flights shows of one craft: tables in the paper's form, and tests of residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from core.quantity import column, counted, number
from core.table import Row, Table
from logparse import Finding, Vehicle
from pipeline.results.advice import Advice
from pipeline.results.model_report import ByOutput, ModelReport
from pipeline.results.report import CraftReport
from pipeline.results.verdict import Verdict
from reports.figures.figure import Figure
from reports.numbers.rows import PAPER_AVERAGE, average
from reports.views import summary
from reports.views.model_board import Board
from reports.views.models import Judgement, ShownModel, ShownThrust
from reports.views.parameters import ShownCoherence, ShownParameters
from reports.views.tables import ShownVerdict, rmse_heads, rmse_lines

#: The kind of model that the paper's table is about, and what its line is called.
PAPER_KIND = "motors"
PAPER_LINE = "Elhesasy 2024, average of nine flights of its own craft"


@dataclass(frozen=True, slots=True)
class CraftSection:
    """What the page on all flights shows of one craft.

    Attributes are texts, tables and plots in the order of the page; None or empty where there is nothing to show.
    """

    id: str
    name: str
    verdict: Verdict
    verdicts: Sequence[ShownVerdict]
    sentences: Sequence[str]
    split: str  #: How the flights to fit were chosen.
    missing: Sequence[tuple[str, str]]  #: What could not be done, and why.
    average: Table | None  #: Errors averaged over the flights held out.
    ahead: Figure | None
    board: Board | None  #: Residuals and responses of the joint models.
    horizons: Table | None
    judgements: Sequence[Judgement]
    residuals: Table | None
    coherence: ShownCoherence | None
    validation: Table | None  #: Errors flight by flight.
    prediction: Choice | None  #: Plots of flights to choose from.
    coverage: Table | None
    coverage_findings: Sequence[Finding]
    outside: Sequence[str]  #: Flights that leave what was fitted.
    covered: Sequence[Figure]
    vehicle: Sequence[tuple[str, str]]
    thrust: ShownThrust
    parameters: ShownParameters | None
    drift: Table | None
    drift_findings: Sequence[Finding]
    drift_sentences: Sequence[str]
    courses: Sequence[Figure]  #: Parameters over the flights.
    courses_folded: Sequence[Figure]
    models: Sequence[ShownModel]
    findings: Sequence[Finding]  #: Those that stand nowhere else.
    advice: Sequence[Advice]


@dataclass(frozen=True, slots=True)
class Choice:
    """Plots of which a reader chooses one: where it is drawn; id, name and page of each by what its flight is for."""

    place: str
    parts: Sequence[tuple[str, Sequence[tuple[str, str, str]]]]
    caption: str
    height: int
    page: str


def average_table(craft: CraftReport) -> Table | None:
    """Set the models side by side with their average errors over the flights held out: the last line of Table 4."""
    judged = [result for result in craft.models if result.rmse_average_m]
    if not judged:
        return None
    outputs = list(judged[0].rmse_average_m)
    held = judged[0].held_out
    lines: list[tuple[str, str, ByOutput]] = [("", result.title, result.rmse_average_m) for result in judged]
    lines.append(("baseline", "Always predicting the mean", average([row.rmse_mean_m for row in held])))
    lines.append(("baseline", "Standing still", average([row.rmse_constant_position_m for row in held])))
    if outputs == list(PAPER_AVERAGE):
        lines.append(("baseline", PAPER_LINE, PAPER_AVERAGE))
    cells = rmse_lines(row for _, _, row in lines)
    return Table(
        label="Model",
        heads=rmse_heads(outputs),
        rows=[Row(label, line, kind) for (kind, label, _), line in zip(lines, cells, strict=True)],
        caption="Root-mean-square error of the joint models’ free run over whole flights, from the inputs and the "
        f"initial state alone, averaged over the {counted(len(held), 'flight')} held out. "
        f"{craft.split[0].upper()}{craft.split[1:]}.",
    )


def validation_table(craft: CraftReport, links: Mapping[str, str]) -> Table | None:
    """Lay the joint models' errors out as Table 4 of Elhesasy 2024: a line per held-out flight, and their average."""
    judged = [result for result in craft.models if result.rmse]
    if not judged:
        return None
    outputs = list(judged[0].rmse[0].rmse_m)
    lines: list[tuple[Row, list[ByOutput]]] = []
    for part, said in (
        ("held-out", "Held out: these flights judge the models"),
        ("training", "Fitted: these flights show only how closely the models can follow"),
    ):
        names = list(dict.fromkeys(row.flight for result in judged for row in result.rmse if row.part == part))
        if names:
            lines.append((Row(said, kind="part"), [{} for _ in judged]))
        lines += [(Row(name, link=links.get(name)), [_errors(result, name) for result in judged]) for name in names]
        if part == "held-out" and names:
            lines.append((Row("Average", kind="average"), [result.rmse_average_m for result in judged]))
            means: list[ByOutput] = [average([row.rmse_mean_m for row in result.held_out]) for result in judged]
            lines.append((Row("Always predicting the mean", kind="baseline"), means))
            if outputs == list(PAPER_AVERAGE):
                papers: list[ByOutput] = [PAPER_AVERAGE if result.key == PAPER_KIND else {} for result in judged]
                lines.append((Row(PAPER_LINE, kind="baseline"), papers))
    columns = [
        column([cells[place].get(output) for _, cells in lines]) for place in range(len(judged)) for output in outputs
    ]
    return Table(
        label="Flight",
        heads=outputs * len(judged),
        rows=[
            row if row.kind == "part" else replace(row, cells=[cells[place] for cells in columns])
            for place, (row, _) in enumerate(lines)
        ],
        caption="Flight by flight, RMSE of the free run in metres.",
        groups=[result.title for result in judged],
    )


def _errors(result: ModelReport, flight: str) -> ByOutput:
    return next((row.rmse_m for row in result.rmse if row.flight == flight), {})


def residual_table(models: Sequence[ModelReport]) -> Table | None:
    """Tabulate whether errors one sample ahead are white, and independent of the inputs before them."""
    rows: list[Row] = []
    for result in models:
        tests = {} if result.validation is None else result.validation.residuals
        if tests:
            rows.append(Row(summary.sentence(result.title)[:-1], kind="part"))
        for output, test in tests.items():
            correlations = [value for value in test.autocorrelation if value is not None]
            cells = [
                f"{number(test.whiteness)} ({number(test.whiteness_limit)})",
                f"{number(max(correlations, key=abs, default=None), 2)} (±{number(test.band, 1)})",
                "yes" if test.white else "no",
                _some(test.dependent) or "none",
            ]
            rows.append(Row(output, cells))
    if not rows:
        return None
    return Table(
        label="Output",
        heads=["portmanteau (limit)", "autocorrelation (band)", "white", "inputs that foretell"],
        rows=rows,
        caption="Tested are the errors of predictions one sample ahead on flight time not used in the fit: the "
        "portmanteau statistic and the largest autocorrelation, each with the limit that a right model passes 99 times "
        "in a hundred, and whether earlier inputs foretell the errors.",
    )


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{', '.join(names[:2])} and {len(names) - 2} more"


def vehicle_facts(vehicle: Vehicle) -> list[tuple[str, str]]:
    """Describe a craft by what its logs say of it."""
    spin = (vehicle.spin_arm, vehicle.spin_min, vehicle.spin_max)
    facts = [
        ("frame", summary.frame(vehicle) + (f", {len(vehicle.motors)} motors" if vehicle.motors else "")),
        ("firmware", summary.firmware(vehicle) or "not described"),
        ("board", vehicle.board_id or ""),
        ("motor outputs", _pair(vehicle.pwm_min, vehicle.pwm_max, "µs")),
        ("spin when armed, least, most", ", ".join(number(value, 2) for value in spin)),
        ("thrust curve (MOT_THST_EXPO)", number(vehicle.thrust_expo, 3)),
    ]
    return [(name, text) for name, text in facts if text]


def _pair(low: float | None, high: float | None, unit: str) -> str:
    return "" if low is None or high is None else f"{number(low, 4)} to {number(high, 4)} {unit}"
