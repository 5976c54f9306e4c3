"""Physical parameters followed over the flights of a craft: whether they scatter, drift or jump, or a motor weakens.

Every flight's own estimate and standard error enter a random-effects meta-regression (`pipeline.fleet.meta_analysis`).
For each parameter two questions are asked: does it change steadily from flight to flight (a slope), and did it change
once (a step between two flights, its place searched for and paid for by Bonferroni's factor)? All questions about one
craft together are corrected by Holm's procedure, so that the chance of any false alarm stays below `ALPHA`.

A motor that gives less than its command is asked for more, but not by itself: the controller knows three ways to
restore the moments (roll, pitch, yaw), and the mixer spreads each over all motors. A motor k that lost the part d of
its thrust leads to the trims ``z = d q_k``, with q_k those that it would take if it gave nothing
(`sysid.rotors.steady_trims`); a shift of the centre of gravity leads to roll and pitch only; a twist of motors about
their arms to yaw.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import fdtrc as f_sf
from scipy.special import ndtr as normal_cdf
from scipy.special import ndtri as normal_quantile

from logparse import Finding, Severity
from pipeline.fleet.history import FEWEST_ASIDE, fit_change, history, sentence_of
from pipeline.fleet.meta_analysis import ALPHA, holm
from pipeline.flight.craft import in_order, took_off
from pipeline.flight.summary import BATTERY
from pipeline.results.drift import Drift, FlightPoint, History, MotorDrift, MotorWork, Step, Trend
from pipeline.results.fleet import FlightParameter
from sysid.rotors.motor_faults.trims import weak_from_start

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pipeline.results.fleet import FlightEntry

    Floats = NDArray[np.float64]


#: What may have changed when a parameter did.
_CAUSES: Mapping[str, str] = {
    "thrust over mass": "weigh the craft, and compare propellers and motors with those of the earlier flights",
    "thrust curve": "check whether propellers or ESC settings were changed",
    "motor lag": "check ESC settings and propellers",
    "roll inertia over mass and arm": "check what was mounted or moved on the craft",
    "pitch inertia over mass and arm": "check what was mounted or moved on the craft",
    "yaw torque over inertia": "check propellers and what was mounted on the craft",
    "linear drag over mass": "check propellers and what was mounted outside",
    "quadratic drag over mass": "check what was mounted outside",
}


def follow(entries: Iterable[FlightEntry]) -> Drift | None:
    """Follow the parameters of one craft over its flights; None with fewer than two flights that say anything."""
    flights = in_order(entries)
    number = {flight.name: k for k, flight in enumerate(flights, start=1)}
    series: dict[str, dict[str, list[FlightPoint]]] = defaultdict(lambda: defaultdict(list))
    units: dict[str, str] = {}
    for flight in flights:
        rows = [row for row in flight.parameters if row.method != BATTERY]
        for row in (*rows, *trims(flight)):
            series[row.parameter][row.method].append(_point(flight, number[flight.name], row))
            units[row.parameter] = row.unit
    histories = [
        history(parameter, units[parameter], methods)
        for parameter, methods in series.items()
        if max(map(len, methods.values())) >= 2
    ]
    if not histories:
        return None
    histories, joint = _judged(histories, together(flights, histories))
    motors = motor_drift(flights, histories, joint)
    steady = [flight.trims for flight in flights if flight.trims is not None]
    # Flights whose responses are laid over each other: of more, none can be told apart.
    return Drift(
        order="name" if any(flight.start_utc is None for flight in flights) else "date",
        flights=tuple(flight.name for flight in flights),
        parameters=tuple(histories),
        motors=motors,
        findings=(
            *_findings(histories),
            *(motors.findings if motors is not None else ()),
            *(weak_from_start(steady[-1], steady[:-1]) if steady else ()),
        ),
        responses=tuple(curve for flight in flights[-8:] for curve in flight.responses),
    )


def _point(flight: FlightEntry, number: int, row: FlightParameter) -> FlightPoint:
    start = took_off(flight)
    return FlightPoint(
        flight=flight.name,
        number=number,
        start_utc=None if start is None else start.isoformat(),
        value=row.value,
        sigma=row.sigma,
    )


def _judged(histories: Sequence[History], joint: Together | None) -> tuple[list[History], Together | None]:
    """Correct all probabilities together and say what came of it."""
    asked = [(k, name) for k, history in enumerate(histories) for name in ("trend", "step") if getattr(history, name)]
    chances = [getattr(histories[k], name).p for k, name in asked]
    *adjusted, of_motors = holm([*chances, 1.0 if joint is None else joint.p])
    p_values = dict(zip(asked, adjusted, strict=True))
    judged = []
    for k, former in enumerate(histories):
        tests = {
            name: replace(getattr(former, name), p_adjusted=p_values[k, name], significant=p_values[k, name] < ALPHA)
            for name in ("trend", "step")
            if (k, name) in p_values
        }
        corrected = replace(former, **tests)
        judged.append(replace(corrected, sentence=sentence_of(corrected, len(asked))))
    if joint is not None:
        change = replace(joint.change, p_adjusted=of_motors, significant=of_motors < ALPHA)
        joint = replace(joint, change=change)
    return judged, joint


def _findings(histories: Sequence[History]) -> list[Finding]:
    findings = []
    for drifted in histories:
        change = drifted.change
        if change is None or drifted.method == STEADY:  # for `motor_drift` to put in words
            continue
        findings.append(
            Finding(
                "parameter-drift",
                Severity.WARNING,
                drifted.sentence,
                _CAUSES.get(drifted.parameter, ""),
                {"parameter": drifted.parameter, "p": change.p_adjusted, "flights": len(drifted.flights)},
            )
        )
    return findings


#: Trims in the order of `SteadyTrims`, and what stands for their method.
TRIMS, STEADY = ("roll trim", "pitch trim", "yaw trim"), "steady trims"

#: An explanation stands if the change that it leaves would be larger by chance with this probability.
STANDS = 0.01


def trims(flight: FlightEntry) -> list[FlightParameter]:
    """Return roll, pitch and yaw trim of a flight as rows like those of `flight_parameters`."""
    if flight.trims is None:
        return []
    rows = zip(TRIMS, flight.trims.trims, flight.trims.variance, strict=True)
    return [
        FlightParameter(parameter=name, method=STEADY, value=value, sigma=variance**0.5, unit="")
        for name, value, variance in rows
    ]


@dataclass(frozen=True, slots=True)
class Together:
    """What all trims together say: the change that most looks like one motor's loss of thrust, and how surely."""

    change: Trend | Step  #: Of the trim that shows it best.
    p: float  #: Chance of one so clear in any motor, at any time, where nothing changes.


def together(flights: Sequence[FlightEntry], histories: Sequence[History]) -> Together | None:
    """Ask all trims at once whether a motor lost thrust; None where they are not known or there are too few flights.

    A motor's loss moves every trim in a known direction and by known parts. Each trim's slope (or step, at the place
    that all trims together prefer) is judged by its own scatter over flights, one-sided, and these chances are combined
    with the motor's parts as weights (Stouffer's method, Lipták 1958): that is exact whatever the scatter of each trim
    is. Motors, the two kinds of change and the places of a step are paid for by Bonferroni's factor.
    """
    followed = [history for history in histories if history.method == STEADY and history.trend is not None]
    motor_rows = _rows(flights, followed)
    if motor_rows is None or len({tuple(point.number for point in history.flights) for history in followed}) != 1:
        return None
    _, rows = motor_rows
    points = [history.flights for history in followed]
    at = _place(points)
    asked: list[Together] = []
    for kind, tried in (("trend", 1), ("step", len(points[0]) - 2 * FEWEST_ASIDE + 1)):
        step = points[0][at].number if kind == "step" else None
        fits = [fit_change(trim, step).test([0.0, 1.0]) for trim in points]
        estimates, sigmas, two_sided = np.array(fits).T
        clear = -normal_quantile(np.maximum(0.5 * two_sided, np.finfo(float).tiny)) * np.sign(estimates)
        score = float(np.max(rows @ clear / np.linalg.norm(rows, axis=1)))
        leading = int(np.argmax(np.abs(estimates / np.maximum(sigmas, np.finfo(float).tiny))))
        p = min(1.0, 2.0 * tried * len(rows) * float(normal_cdf(-score)))
        change: Trend | Step
        if kind == "trend":
            change = Trend(per_flight=estimates[leading], per_flight_sigma=sigmas[leading], p=p)
        else:
            before, after = points[0][at - 1], points[0][at]
            change = Step(
                before=before.flight,
                after=after.flight,
                number=after.number,
                change=estimates[leading],
                sigma=sigmas[leading],
                p=p,
            )
        asked.append(Together(change, p))
    return min(asked, key=lambda candidate: candidate.p)


def _place(points: Sequence[Sequence[FlightPoint]]) -> int:
    """Return the place of a step that all trims together prefer, each in units of its own scatter."""
    count = len(points[0])
    values = np.array([[point.value for point in trim] for trim in points])
    values = values - values.mean(axis=1, keepdims=True)
    places = np.arange(FEWEST_ASIDE, count - FEWEST_ASIDE + 1)
    between = np.cumsum(values, axis=1)[:, places - 1] ** 2 * count / (places * (count - places))
    # As the log-likelihood ratio of each trim, whose scatter about the step is not known.
    whole = np.maximum((values**2).sum(axis=1, keepdims=True), np.finfo(float).tiny)
    return int(places[np.argmin(np.log(np.maximum(1.0 - between / whole, 1e-12)).sum(axis=0))])


def motor_drift(
    flights: Sequence[FlightEntry], histories: Sequence[History], joint: Together | None = None
) -> MotorDrift | None:
    """Interpret changes of the trims; None where no flight tells its trims."""
    with_trims = [flight for flight in flights if flight.trims is not None]
    if not with_trims:
        return None
    points = tuple(
        MotorWork(
            flight=flight.name,
            start_utc=None if flight.start_utc is None else flight.start_utc.isoformat(),
            work=_work(flight),
        )
        for flight in with_trims
    )
    followed = [history for history in histories if history.method == STEADY]
    changed = [(history.change.p, history) for history in followed if history.change is not None]
    p = None if joint is None else joint.p
    if joint is not None and joint.change.significant:
        return replace(_explained(with_trims, points, followed, joint.change, "all trims together"), p=p)
    if changed:
        leading = min(changed, key=lambda pair: pair[0])[1]
        assert leading.change is not None
        return replace(_explained(with_trims, points, followed, leading.change, leading.sentence), p=p)
    asked = any(history.trend is not None for history in followed)
    sentence = (
        "no motor is seen to weaken: what is steadily asked of the motors does not change over flights"
        if asked
        else "whether a motor weakens cannot be told: that takes four flights of a frame whose geometry is known"
    )
    return MotorDrift(points=points, sentence=sentence, p=p)


def _work(flight: FlightEntry) -> dict[str, float]:
    """Return how hard each motor worked, over the mean of all, named as in trims; nothing where outputs do not tell."""
    motors = None if flight.account is None else flight.account.motors
    mean = 0.0 if motors is None else sum(motors.mean.values()) / len(motors.mean)
    if motors is None or not mean > 0.0:
        return {}
    return {f"m{number}": work / mean for number, work in motors.mean.items()}


def _explained(
    flights: Sequence[FlightEntry],
    points: tuple[MotorWork, ...],
    followed: Sequence[History],
    change: Trend | Step,
    seen: str,
) -> MotorDrift:
    """Find what explains the change of all trims: one motor, the centre of gravity, a twist, or none alone."""
    steady = isinstance(change, Trend)
    fits = [fit_change(history.flights, None if isinstance(change, Trend) else change.number) for history in followed]
    estimates, sigmas, _ = np.array([fitted.test([0.0, 1.0]) for fitted in fits]).T
    motor_rows = _rows(flights, followed)
    assert motor_rows is not None
    motors, rows = motor_rows
    b, weights = estimates, 1.0 / sigmas**2

    def chance(squares: float, count: int) -> float:
        """Return the chance of more than this sum of `count` squares, whose standard errors are estimates too."""
        return float(f_sf(max(count, 1), max(min(fitted.df for fitted in fits), 1), squares / max(count, 1)))

    standing: list[tuple[float, str, float, float]] = []
    for motor, row in zip(motors, rows, strict=True):
        information = float(row**2 @ weights)
        if information <= 0.0:
            continue
        loss = float(row * weights @ b) / information
        p = chance(float(weights @ (b - loss * row) ** 2), len(b) - 1)
        if loss > 0.0 and p >= STANDS:
            standing.append((p, motor, loss, information**-0.5))
    standing.sort(reverse=True)
    others = [
        text
        for text, kept in (
            ("a shift of the centre of gravity", TRIMS[:2]),
            ("motors twisted about their arms", TRIMS[2:]),
        )
        if (rest := [k for k, history in enumerate(followed) if history.parameter not in kept])
        and len(rest) < len(b)
        # What is left over when this is taken away must look like chance.
        and chance(float(weights[rest] @ b[rest] ** 2), len(rest)) >= STANDS
    ]
    when = f"between {change.before} and {change.after}" if isinstance(change, Step) else "from flight to flight"
    if standing:
        _, motor, loss, sigma = standing[0]
        sentence = (
            f"motor {motor} is weakening: what is steadily asked of the motors changes {when} as if it lost "
            f"{100.0 * loss:.2g} ± {100.0 * sigma:.1g} % of its thrust{' per flight' if steady else ''}"
        )
        rivals = [*(f"motor {name}" for _, name, *_ in standing[1:]), *others]
        if rivals:
            sentence += f"; {' or '.join(rivals)} would look alike"
        advice = f"check motor {motor.removeprefix('m')}, its propeller and its ESC"
        findings = (Finding("motor-weakening", Severity.WARNING, sentence, advice),)
        return MotorDrift(points=points, weakening=motor, loss=loss, sentence=sentence, findings=findings)
    why = f"{' or '.join(others)} explains it" if others else "no single motor explains it by losing thrust"
    sentence = f"what is steadily asked of the motors changes {when} ({seen}); {why}"
    advice = "check the centre of gravity and the motors' mounts"
    findings = (Finding("parameter-drift", Severity.WARNING, sentence, advice),)
    return MotorDrift(points=points, sentence=sentence, findings=findings)


def _rows(flights: Sequence[FlightEntry], followed: Sequence[History]) -> tuple[tuple[str, ...], Floats] | None:
    """Return the motors, and what a loss of each does to the trims that are followed, (motors, trims)."""
    steady = next((flight.trims for flight in flights if flight.trims is not None), None)
    if steady is None or not followed:
        return None
    return steady.motors, np.array(steady.rows)[:, [TRIMS.index(history.parameter) for history in followed]]
