"""Is a motor weakening? What the hover command of each flight says, and which motor it points to.

A motor that gives less than its command is asked for more, but not by itself: the controller knows three ways to
restore the moments (roll, pitch, yaw), and the mixer spreads each over all motors. With the mixer's factors as
orthonormal columns Q (motors, 3) and the motors' shares s of the hover command, the trims ``z = Q^T s`` hold all that
the controller did. A motor k that lost the part d of its thrust leads to ``z = d q_k`` with q_k the k-th row of Q; a
shift of the centre of gravity leads to roll and pitch only; a twist of motors about their arms to yaw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc as chi2_sf

from logparse import Finding, Severity
from pipeline.fleet.history import design_of
from pipeline.fleet.meta_analysis import meta_regression
from pipeline.flight.flight_parameters import SHARES
from pipeline.results.drift import History, MotorDrift, MotorShares, Step, Trend
from pipeline.results.entry import FlightParameter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pipeline.results.entry import FlightEntry

    Floats = NDArray[np.float64]

#: Trims in the order of the columns of Q.
TRIMS = ("roll trim", "pitch trim", "yaw trim")

#: An explanation stands if the change that it leaves would be larger by chance with this probability.
STANDS = 0.05

#: Column of the mixer below this part of the largest is none.
_NONE = 1e-6


def trims(flight: FlightEntry) -> list[FlightParameter]:
    """Return roll, pitch and yaw trim of a flight's hover command as rows like those of `flight_parameters`.

    They have no unit: root of the sum of squares over the motors of the change in their shares.
    """
    shares = _shares(flight)
    found = _basis(flight.mixer, tuple(shares))
    if found is None:
        return []
    names, basis = found
    values, sigmas = np.array(list(shares.values())).T
    return [
        FlightParameter(
            parameter=name,
            method=SHARES,
            value=float(column @ values),
            sigma=float(np.sqrt(np.sum((column * sigmas) ** 2))),
            unit="",
        )
        for name, column in zip(names, basis.T, strict=True)
    ]


def motor_drift(flights: Sequence[FlightEntry], histories: Sequence[History]) -> MotorDrift | None:
    """Interpret changes of the trims; None where no flight tells the motors' shares.

    Parameters
    ----------
    flights : sequence of FlightEntry
        In order.
    histories : sequence of History
        Of all parameters, judged; the trims among them count.
    """
    told = [flight for flight in flights if _shares(flight)]
    if not told:
        return None
    points = tuple(
        MotorShares(
            flight=flight.name,
            start_utc=None if flight.start_utc is None else flight.start_utc.isoformat(),
            shares=_shares(flight),
        )
        for flight in told
    )
    followed = [each for each in histories if each.method == SHARES]
    changed = [(each.change.p, each) for each in followed if each.change is not None]
    if changed:
        return _explained(told, points, followed, min(changed, key=lambda pair: pair[0])[1])
    asked = any(each.trend is not None for each in followed)
    sentence = (
        "no motor is seen to weaken: the motors' shares of the hover command do not change over flights"
        if asked
        else "whether a motor weakens cannot be told: that takes four flights of a frame whose geometry is known"
    )
    return MotorDrift(points=points, weakening=None, loss=None, loss_sigma=None, sentence=sentence)


def _explained(
    flights: Sequence[FlightEntry], points: tuple[MotorShares, ...], followed: Sequence[History], leading: History
) -> MotorDrift:
    """Find what explains the change of all trims: one motor, the centre of gravity, a twist, or none alone."""
    change = leading.change
    assert change is not None
    steady = isinstance(change, Trend)
    estimates, sigmas = [], []
    for each in followed:
        values, errors = ([getattr(point, name) for point in each.flights] for name in ("value", "sigma"))
        estimate, sigma, _ = meta_regression(values, errors, design_of(each.flights, change)).test([0.0, 1.0])
        estimates.append(estimate)
        sigmas.append(sigma)
    motors = tuple(_shares(flights[0]))
    found = _basis(flights[0].mixer, motors)
    assert found is not None
    names, basis = found
    known = [names.index(each.parameter) for each in followed]
    b, weights, rows = np.array(estimates), 1.0 / np.array(sigmas) ** 2, basis[:, known]
    standing: list[tuple[float, str, float, float]] = []
    for motor, row in zip(motors, rows, strict=True):
        information = float(row**2 @ weights)
        if information <= 0.0:
            continue
        loss = float(row * weights @ b) / information
        p = float(chi2_sf(max(len(b) - 1, 1), float(weights @ (b - loss * row) ** 2)))
        if loss > 0.0 and p >= STANDS:
            standing.append((p, motor, loss, information**-0.5))
    standing.sort(reverse=True)
    others = [
        text
        for text, kept in (
            ("a shift of the centre of gravity", TRIMS[:2]),
            ("motors twisted about their arms", TRIMS[2:]),
        )
        if (rest := [k for k, each in enumerate(followed) if each.parameter not in kept])
        and len(rest) < len(b)
        # What is left over when this is taken away must look like chance.
        and float(chi2_sf(len(rest), float(weights[rest] @ b[rest] ** 2))) >= STANDS
    ]
    when = f"between {change.before} and {change.after}" if isinstance(change, Step) else "from flight to flight"
    if not standing:
        sentence = f"the motors' shares of the hover command change {when} ({leading.sentence}); " + (
            f"{' or '.join(others)} explains it" if others else "no single motor explains it by losing thrust"
        )
        return MotorDrift(
            points=points,
            weakening=None,
            loss=None,
            loss_sigma=None,
            sentence=sentence,
            findings=(
                Finding(
                    "hover-trim-drift",
                    Severity.WARNING,
                    sentence,
                    "check the centre of gravity and the motors' mounts",
                ),
            ),
        )
    _, motor, loss, sigma = standing[0]
    sentence = (
        f"motor {motor} is weakening: the motors' shares of the hover command change {when} as if it lost "
        f"{100.0 * loss:.2g} ± {100.0 * sigma:.1g} % of its thrust{' per flight' if steady else ''}"
    )
    rivals = [*(f"motor {name}" for _, name, *_ in standing[1:]), *others]
    if rivals:
        sentence += f"; {' or '.join(rivals)} would look alike"
    return MotorDrift(
        points=points,
        weakening=motor,
        loss=loss,
        loss_sigma=sigma,
        sentence=sentence,
        findings=(
            Finding(
                "motor-weakening",
                Severity.WARNING,
                sentence,
                f"check motor {motor.removeprefix('m')}, its propeller and its ESC",
            ),
        ),
    )


def _shares(flight: FlightEntry) -> dict[str, tuple[float, float]]:
    return {row.parameter: (row.value, row.sigma) for row in flight.parameters if row.method == SHARES}


def _basis(mixer: Mapping[str, Sequence[float]], motors: Sequence[str]) -> tuple[list[str], Floats] | None:
    """Orthonormal columns of the mixer for these motors, (motors, trims); None where the geometry is not known."""
    if not motors or not set(motors) <= mixer.keys() or len(motors) != len(mixer):
        return None
    factors = np.array([mixer[motor] for motor in motors], dtype=np.float64)
    factors = factors - factors.mean(axis=0)
    size = np.linalg.norm(factors, axis=0)
    made = [k for k in range(factors.shape[1]) if size[k] > _NONE * max(float(size.max()), 1e-300)]
    if not made:
        return None
    basis, _ = np.linalg.qr(factors[:, made])
    basis = basis * np.sign(np.sum(basis * factors[:, made], axis=0))
    return [TRIMS[k] for k in made], basis
