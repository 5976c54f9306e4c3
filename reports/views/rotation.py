"""How a craft turns, as sentences and tables: responses of its axes, attitude following and margins of its loops."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from core.parameter import Parameter
from core.quantity import joined, uncertain
from core.table import Row, Table
from logparse import Finding
from pipeline.results.rotation import AxisCoupling, AxisRotation, RotationResult
from reports.figures.figure import Figure
from reports.figures.frequency import bode_figure
from sysid.frequency.time_domain import GOOD_THEIL, UNRELATED
from sysid.loops.known_margins import MARGINS, Margins

#: Names of margins for readers.
TITLES = {
    "gain_db": "Gain margin",
    "phase_deg": "Phase margin",
    "crossover_hz": "Crossover",
    "rejection_hz": "Disturbance-rejection bandwidth",
    "peak_db": "Peak of the sensitivity",
}

#: Parameters in the order of their table, and its heads.
_SHOWN = ("gain", "damping", "lag", "lead", "effective_delay", "mode_frequency", "mode_damping")
_HEADS = ("gain", "damping", "lag", "lead", "delay", "mode", "mode damping", "J", "coherent", "attitude bandwidth")

#: What stands in a cell without a number.
_NOTHING = "–"


def rotation_figures(axes: Iterable[AxisRotation]) -> list[Figure]:
    """Draw the responses of the axes, and how they follow their attitude targets where that is known."""
    figures = []
    for axis in axes:
        if axis.rate is not None:
            figures.append(bode_figure(axis.rate, f"bode-{axis.axis}"))
        if axis.attitude is not None and axis.attitude.determined:
            figures.append(bode_figure(axis.attitude.response, f"attitude-{axis.axis}"))
    return figures


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """The sections of a flight's page on how the craft turns, and on its loops."""

    sentences: Sequence[str]
    table: Table | None
    figures: Sequence[Figure]
    loops: Table | None
    warnings: Sequence[Finding]
    doubts: Sequence[str]  #: What weakens the margins.
    reasons: Sequence[tuple[str, str]]  #: Why margins are not determined, by axes.


def rotation_view(rotation: RotationResult | None, file: str) -> Turning | None:
    """Return the view of a flight's rotation and loops; None where no rotation was estimated."""
    if rotation is None:
        return None
    lines = [sentence for axis in rotation.every for sentence in sentences(axis)]
    lines += [coupling_sentence(coupling) for coupling in rotation.couplings if coupling.ratio.value is not None]
    remarks = [remark for loop in rotation.loops.values() for remark in loop.remarks]
    return Turning(
        sentences=[line.replace(f"{file}: ", "") for line in lines],
        table=parameter_table(rotation.every) if rotation.determined else None,
        figures=rotation_figures(rotation.every),
        loops=loop_table(rotation),
        warnings=loop_warnings(rotation),
        doubts=[_sentence(remark, file) for remark in remarks],
        reasons=_loop_reasons(rotation, file),
    )


def _sentence(clause: str, file: str) -> str:
    """Make a sentence of a clause in which the log is called by the name of its file."""
    text = clause.replace(f"{file}: ", "").replace(f"{file} ", "the log ")
    return f"{text[:1].upper()}{text[1:]}."


def loop_warnings(rotation: RotationResult) -> list[Finding]:
    """Return what endangers a craft by its loops."""
    return [finding for finding in rotation.findings if finding.id == "loop-margins"]


def sentences(axis: AxisRotation) -> list[str]:
    """Return what is known of an axis in words, or why nothing is and what to fly."""
    said = []
    name = axis.axis.capitalize()
    gain = None if axis.rate is None else axis.rate.parameters.get("gain")
    if axis.rate is not None and gain is not None:
        if gain.value is not None:
            delay = axis.rate.parameters.get("effective_delay")
            said.append(
                f"{name}: {_text(gain)} per unit of output"
                + (f", delay {_milliseconds(delay)}" if delay is not None and delay.value is not None else "")
                + f"; the fit is {axis.rate.verdict} (J {axis.rate.cost:.0f})"
                + (f", from {axis.rate.source}." if axis.rate.source else ".")
            )
            said += _checked(axis)
        else:
            said.append(f"{name}: the gain is not determined: {gain.reason}.")
    elif axis.reason:
        what = "of the rate loop" if axis.axis != "vertical" else "to thrust"
        said.append(f"{name}: no response {what}: {axis.reason}.")
    if axis.attitude is not None and axis.attitude.determined:
        said.append(
            f"The {axis.axis} attitude follows its target up to {_text(axis.attitude.bandwidth)} "
            f"with a phase delay of {_milliseconds(axis.attitude.phase_delay)}."
        )
    elif axis.attitude is not None and not axis.determined:
        reason = axis.attitude.bandwidth.reason or axis.attitude.phase_delay.reason
        said.append(f"How the {axis.axis} attitude follows its target is not determined: {reason}.")
    elif axis.attitude_reason and not axis.determined:
        said.append(f"{name} attitude: {axis.attitude_reason.removeprefix(f'{axis.axis}: ')}.")
    return said


def _checked(axis: AxisRotation) -> list[str]:
    """Return how the model of an axis predicted held-out flying, or why none was held out."""
    assert axis.rate is not None
    check, reason = axis.rate.check, axis.rate.check_reason
    if check is None:
        return [f"No flying is left to judge the {axis.axis} model: {reason}."] if reason else []
    text = (
        f"Of {check.seconds:.0f} s that were held out, such a model explains {max(check.fit_percent, 0.0):.0f} % "
        f"(Theil’s coefficient {check.theil:.2f}, good up to {GOOD_THEIL:g}): {check.verdict}"
    )
    if check.correlation > UNRELATED:
        text += (
            f"; its errors go with what was asked ({check.correlation:.1f} standard deviations): it misses something"
        )
    if check.residuals:
        text += f"; {check.residuals}"
    return [f"{text}."]


def coupling_sentence(coupling: AxisCoupling) -> str:
    """Return what the command of one axis does to another."""
    known = coupling.ratio
    if not coupling.significant:
        most = math.ceil(100.0 * (abs(known.value or 0.0) + 2.0 * (known.sigma or 0.0)))
        return f"A {coupling.axis} command does not turn the craft about {coupling.other}: by {most} % at most."
    return (
        f"A {coupling.axis} command turns the craft about {coupling.other} as well, by "
        f"{uncertain(100.0 * (known.value or 0.0), 100.0 * (known.sigma or 0.0), '%')} of its own answer: look at the "
        "centre of gravity, the autopilot’s mounting and unequal motors."
    )


def parameter_table(axes: Sequence[AxisRotation], *, brief: bool = False) -> Table:
    """Tabulate the parameters by axis, without empty rows; in brief without errors in percent."""
    columns = [_cells(axis, brief) for axis in axes]
    # In brief, sentences beside the table hold the attitude's bandwidth.
    heads = _HEADS[:-1] if brief else _HEADS
    rows = [Row(head, [cells[k] for cells in columns]) for k, head in enumerate(heads)]
    return Table(
        label="",
        heads=[axis.axis for axis in axes],
        rows=[row for row in rows if any(cell != _NOTHING for cell in row.cells)],
        caption="Parameters with one standard deviation; in brackets Cramér-Rao's error and insensitivity in "
        "percent. J up to 50 is excellent, up to 100 good.",
        texts=range(len(axes)),
    )


def loop_table(rotation: RotationResult) -> Table | None:
    """Tabulate the margins of the loops as flown, in both ways; None where none are known."""
    if not rotation.loops:
        return None
    columns: dict[str, list[str]] = {}
    for axis, loop in rotation.loops.items():
        columns[axis] = [str(loop.state), *_margin_cells(loop.computed)]
        if loop.measured is not None:
            columns[f"{axis}, by the chirp"] = ["", *_margin_cells(loop.measured)]
    labels = ["State", *(f"{TITLES[name]}, {unit}" for name, (unit, _) in MARGINS.items())]
    return Table(
        label="Margin",
        heads=list(columns),
        rows=[Row(label, [cells[k] for cells in columns.values()]) for k, label in enumerate(labels)],
        caption="Margins of the loops broken at the mixer, with one standard error: computed from the craft’s "
        "response and the controller of the log’s parameters, and, where the log allows it, measured straight by the "
        "chirp. 6 dB and 45° are sound.",
    )


def _loop_reasons(rotation: RotationResult, file: str) -> list[tuple[str, str]]:
    """List why margins are not determined, each reason once with its axes."""
    reasons: dict[str, list[str]] = {}
    for axis in rotation.axes:
        if axis.loop_reason:
            reasons.setdefault(_sentence(axis.loop_reason, file), []).append(axis.axis)
    return [(joined(axes).capitalize(), reason) for reason, axes in reasons.items()]


def _margin_cells(margins: Margins) -> list[str]:
    parameters: list[Parameter] = [getattr(margins, name) for name in MARGINS]
    return [_NOTHING if margin.value is None else uncertain(margin.value, margin.sigma) for margin in parameters]


def _cells(axis: AxisRotation, brief: bool) -> list[str]:
    cells = [_NOTHING] * len(_SHOWN)
    cost = coherent = bandwidth = _NOTHING
    if axis.rate is not None and axis.rate.cost is not None:
        cells = [_with_errors(axis, name, brief) for name in _SHOWN]
        cost = f"{axis.rate.cost:.1f}"
    if axis.rate is not None and axis.rate.band_hz is not None:
        low, high = axis.rate.band_hz
        coherent = f"{low:.2g}-{high:.3g} Hz"
    if axis.attitude is not None and axis.attitude.determined:
        bandwidth = f"{_text(axis.attitude.bandwidth)}, {_milliseconds(axis.attitude.phase_delay)}"
    return [*cells, cost, coherent, bandwidth]


def _with_errors(axis: AxisRotation, name: str, brief: bool) -> str:
    assert axis.rate is not None
    known = axis.rate.parameters.get(name)
    if known is None:
        return _NOTHING
    if known.value is None or known.sigma is None:
        return "not determined"
    text = _milliseconds(known) if known.unit == "s" else _text(known)
    if known.value == 0.0 or known.unit == "s" or brief:
        return text
    insensitivity = abs(axis.rate.insensitivity[name])
    return f"{text} ({100.0 * known.sigma / abs(known.value):.1f}, {100.0 * insensitivity:.1f} %)"


def _text(known: Parameter) -> str:
    return uncertain(known.value, known.sigma, "" if known.unit == "1" else known.unit.replace("^2", "²"))


def _milliseconds(known: Parameter) -> str:
    if known.value is None or known.sigma is None:
        return "not determined"
    return uncertain(1e3 * known.value, 1e3 * known.sigma, "ms")
