"""How strongly motors turn the craft: effectiveness over inertia from the rate controller's outputs or the motors' PWM.

For each axis, between the angular acceleration and the torque command q (sum of lever times thrust command times
density); lead, in yaw only, is the torque of the rotors' own acceleration::

    w' + damping w = gain (q + lead q') + offset,    q delayed and through a first-order lag

Fourier coefficients of short, tapered, overlapping stretches of the flight turn this into a linear regression over a
band of frequencies, for given lag and delay; these two are found by a search on the remainder. Outputs of the rate
controller are logged together with the rates, fast; motor outputs are often logged at a small part of the loop's rate,
and then show attitude control only in aliases. What one unit of output means in thrust is read off the log: the motors'
total thrust command over the controller's thrust output, which includes whatever the firmware does about voltage and
density. The controller's outputs become commands by the curve in the parameters; what commands do goes by the curve
that the flight shows, whose slope about the command flown is what turns the craft.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from logparse import Vehicle
from sysid.records.experiment import Experiment, Floats
from sysid.records.motor_scaling import curve_slope, motor_commands
from sysid.records.motor_signals import LEAST_SLOPE, MOTOR_OUTPUTS, SCALE_SECONDS, motor_geometry, motor_signals
from sysid.records.resampling import logged_rate
from sysid.records.thrust_curve import Law, thrust_signals
from sysid.rigid_body.filter_error import inverted

AXES = ("roll", "pitch", "yaw")

#: Length of a stretch, s, and how many start within one length.
STRETCH_SECONDS = 8.0
OVERLAP = 2

#: Band, Hz: above wind and trim, below the filters of gyros and structure; and the highest part of the sampling rate.
LOWEST, HIGHEST, NYQUIST_PART = 0.4, 10.0, 0.4

#: Damping so far below zero, in standard errors, is none: the controller's answer to noise is seen, not the craft's.
UNDAMPED = 4.0

#: Standard error that a lag, a delay and a lead of rotation have at best, s: within it one stands for the other.
LAG_SIGMA = 0.005

#: Coherent part below which a gain is not believed: noise in the command would bias it by up to the rest.
COHERENT = 0.9

#: Angular rate (root mean square in the band) below which an axis was hardly moved, rad/s: that of a swing by one
#: degree at 0.6 Hz.
STILL = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisFit:
    """Effectiveness about one axis."""

    #: rad/s^2 for one motor at full command (roll, pitch: on an arm across) in sea-level air.
    gain: float
    gain_sigma: float
    #: 1/s.
    damping: float
    damping_sigma: float
    coherent: float  #: Part of the angular acceleration's power in the band that the command explains (R^2).
    #: Torque of the rotors' own acceleration over that of their drag, as a time, s; in yaw only, else 0.
    lead: float
    lead_sigma: float
    moved: float  #: Root mean square of the angular rate in the band, rad/s.


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationFit:
    """Effectiveness about all axes."""

    axes: dict[str, AxisFit]  #: By roll, pitch, yaw.
    #: First-order lag and pure delay between command and torque, gyro filters included, s.
    lag: float
    delay: float
    lag_sigma: float  #: Of each of them.
    source: str  #: As `MotorSignals.source`.
    rate: float  #: Rows of the source a second.
    per_expo: float = 0.0  #: Relative change of the gains with the curvature of the torque commands.


def centre_of_gravity(
    records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, expo: float, expo_sigma: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Offset of the centre of gravity from the motors' centre, forward and right, each with its sigma, in arms.

    Over a flight the craft does not turn faster and faster, so that the thrust's moment vanishes on average; motors
    that pull unequally show in the same way. An offset is as uncertain as the slope of the curve by which its commands
    are thrust.
    """
    values = _balances(records, vehicle, voltage, expo)
    if len(values) < 4:
        return (0.0, np.inf), (0.0, np.inf)
    mean = values.mean(axis=0)
    bent = _balances(records, vehicle, voltage, expo + expo_sigma).mean(axis=0) - mean
    # The spread of few values is itself not known well: errors in its units are Student's.
    few = np.sqrt((len(values) - 1) / (len(values) - 3) / len(values))
    x, y = zip(mean.tolist(), np.hypot(few * values.std(axis=0, ddof=1), bent).tolist(), strict=True)
    return x, y


def _balances(records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, expo: float) -> Floats:
    """Place of the thrust's centre, forward and right, in arms, over stretches of `SCALE_SECONDS`; shape (S, 2)."""
    places = []
    for record in records:
        thrust = thrust_signals(record, Law.COMMAND, vehicle, voltage, expo)
        geometry = motor_geometry(record)
        size = max(round(SCALE_SECONDS / record.dt), 1)
        for k in range(0, max(len(thrust) - size // 2, 1), size):
            part = thrust[k : k + size].mean(axis=0)
            places.append(part @ np.column_stack([geometry.forward, geometry.right]) / part.sum())
    return np.array(places)


def fit_rotation(
    records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, expo: float | None = None
) -> RotationFit | None:
    """Estimate effectiveness and damping about each axis."""
    expo = vehicle.thrust_expo if expo is None else expo
    parts = [motor_signals(record, Law.COMMAND, vehicle, voltage, expo) for record in records]
    source = parts[0].source
    same = [
        (part.signals @ motor_geometry(record).levers.T, part.rates)
        for record, part in zip(records, parts, strict=True)
        if part.source == source
    ]
    # Rates and outputs of one message fade alike on the lines between rows, up to where these fold.
    rate = min(logged_rate(np.hstack(pair), records[0].dt) for pair in same)
    slow = np.inf if source == MOTOR_OUTPUTS else rate
    spectra = rotation_spectra(
        [commands for commands, _ in same], [rates for _, rates in same], records[0].dt, NYQUIST_PART * slow
    )
    if spectra is None:
        return None
    omega, q, w = spectra
    # Yaw is left out: the torque by which rotors speed up comes before that by which they turn, and hides the lag.
    sums = [np.sum(part, axis=0)[:, :2].T for part in (np.abs(q) ** 2, q.conj() * w, np.abs(w) ** 2)]

    def remainder(x: Floats) -> float:
        return _remainder(omega, sums, float(x[0]), float(x[1]))

    bounds = [(0.0, 0.3), (-0.05, 0.2)]
    solved = scipy.optimize.minimize(remainder, [0.01, 0.01], method="Nelder-Mead", bounds=bounds)
    lag, delay = (float(value) for value in solved.x)
    lag_sigma = _exchanged(remainder, solved.x, q.shape[0] * q.shape[1] // OVERLAP)
    moved = _band_rates(w, records[0].dt)
    axes = {
        axis: _axis(omega, q[:, :, k], w[:, :, k], lag, delay, axis == "yaw", float(moved[k]))
        for k, axis in enumerate(AXES)
    }
    command = float(np.mean([np.clip(motor_commands(record.u, vehicle), 0.0, 1.0).mean() for record in records]))
    # Gain times slope is what the flight shows.
    per_expo = (1.0 - 2.0 * command) / max(float(curve_slope(np.array(command), expo)), LEAST_SLOPE)
    return RotationFit(
        axes=axes,
        lag=lag,
        delay=delay,
        lag_sigma=lag_sigma,
        source=source,
        rate=rate,
        per_expo=per_expo,
    )


def rotation_spectra(
    commands: Sequence[Floats], rates: Sequence[Floats], dt: float, top: float = np.inf
) -> tuple[Floats, np.ndarray, np.ndarray] | None:
    """Fourier coefficients of commands and rates in the band, over stretches of all records.

    Shapes: `commands`, `rates` (N_r, k) and (N_r, 3).
    """
    top = min(HIGHEST, NYQUIST_PART / dt, top)
    taken = [_spectra(q, w, dt, top) for q, w in zip(commands, rates, strict=True)]
    spectra = [part for part in taken if part is not None]
    if not spectra or len(spectra[0][0]) < 3:
        return None
    (omega, *_), *_ = spectra
    return omega, np.concatenate([q for _, q, _ in spectra]), np.concatenate([w for _, _, w in spectra])


def _spectra(commands: Floats, rates: Floats, dt: float, top: float) -> tuple[Floats, np.ndarray, np.ndarray] | None:
    """Fourier coefficients of tapered stretches in the band: frequencies (F,), commands and rates (S, F, 3)."""
    size = round(STRETCH_SECONDS / dt)
    if len(commands) < size or top <= LOWEST:
        return None
    starts = range(0, len(commands) - size + 1, size // OVERLAP)
    taper = np.hanning(size)[:, None]
    frequency: Floats = np.fft.rfftfreq(size, dt).astype(np.float64)
    band = (frequency >= LOWEST) & (frequency <= top)

    def transform(values: Floats) -> np.ndarray:
        stretches = [values[k : k + size] - values[k : k + size].mean(axis=0) for k in starts]
        return np.array([np.fft.rfft(stretch * taper, axis=0)[band] for stretch in stretches])

    return np.asarray(2.0 * np.pi * frequency[band]), transform(commands), transform(rates)


def _shape(omega: Floats, lag: float, delay: float) -> np.ndarray:
    """Response of torque to its command, shape (F,)."""
    return np.asarray(np.exp(-1j * omega * delay) / (1.0 + 1j * omega * lag))


def _remainder(omega: Floats, sums: Sequence[np.ndarray], lag: float, delay: float) -> float:
    """Part of the angular acceleration that command and rate do not explain, summed over axes.

    `sums` are power of the commands, their cross power with the rates, and power of these, (axes, F) each.
    """
    shape = _shape(omega, lag, delay)
    commands, cross, rates = sums[0] @ np.abs(shape) ** 2, sums[1] * shape.conj(), sums[2].sum(axis=1)
    along, both = np.real(1j * omega * cross).sum(axis=1), np.real(cross).sum(axis=1)
    # The rate itself is a quarter of a period beside its derivative.
    explained = along**2 * rates / np.maximum(commands * rates - both**2, 1e-300)
    return float(np.sum(1.0 - explained / np.maximum(sums[2] @ omega**2, 1e-300)))


def _exchanged(remainder: Callable[[Floats], float], best: Floats, count: int) -> float:
    """Return how far lag and delay stand for each other, s: a standard error of either, their sum is surer.

    By how much more of `count` coefficients is left unexplained where one takes from the other; infinite where no more.
    """
    least = remainder(best)
    more = remainder(best + np.array([LAG_SIGMA, -LAG_SIGMA])) - least
    return LAG_SIGMA * float(np.hypot(1.0, np.sqrt(least / (count * more)))) if more > 0.0 else np.inf


def _band_rates(w: np.ndarray, dt: float) -> Floats:
    """Root mean square of the rates in the band, from coefficients (S, F, 3) of Hann-tapered stretches (Parseval)."""
    size = round(STRETCH_SECONDS / dt)
    power = 2.0 * np.sum(np.abs(w) ** 2, axis=1).mean(axis=0)
    return np.asarray(np.sqrt(power / (size * np.sum(np.hanning(size) ** 2))))


def regress_stretches(design: np.ndarray, target: np.ndarray) -> tuple[Floats, Floats, float]:
    """Return coefficients, their standard errors and the part explained of (S, F) by regressors (S, F, k)."""
    flat = design.reshape(-1, design.shape[2])
    normal = np.real(flat.conj().T @ flat)
    inverse = inverted(normal)
    values = inverse @ np.real(flat.conj().T @ target.ravel())
    residual = target - design @ values
    power = float(np.sum(np.abs(target) ** 2))
    explained = 1.0 - float(np.sum(np.abs(residual) ** 2)) / power if power > 0.0 else 0.0
    # Stretches that overlap share noise: sums over neighbours are the clusters.
    scores = np.real(np.einsum("sfk,sf->sk", design.conj(), residual))
    clusters = np.array([scores[k : k + OVERLAP].sum(axis=0) for k in range(0, len(scores), OVERLAP)])
    spare = len(clusters) / max(len(clusters) - max(len(values) / 2.0, 2.0), 1.0)
    sigma = np.sqrt(np.maximum(np.diag(inverse @ (clusters.T @ clusters * spare) @ inverse), 0.0))
    return values, sigma, explained


def _axis(omega: Floats, q: np.ndarray, w: np.ndarray, lag: float, delay: float, lead: bool, moved: float) -> AxisFit:
    torque = q * _shape(omega, lag, delay)
    columns = [torque, -w, 1j * omega * torque][: 3 if lead else 2]
    values, sigma, coherent = regress_stretches(np.stack(columns, axis=-1), 1j * omega * w)
    return AxisFit(
        gain=float(values[0]),
        gain_sigma=float(sigma[0]),
        damping=float(values[1]),
        damping_sigma=float(sigma[1]),
        coherent=coherent,
        lead=float(values[2] / values[0]) if lead and values[0] != 0.0 else 0.0,
        lead_sigma=float(np.hypot(LAG_SIGMA, sigma[2] / values[0])) if lead and values[0] != 0.0 else 0.0,
        moved=moved,
    )
