"""Errors that all of a flight shares, so that no scatter within it shows them: what its inputs hide, what others add.

An attitude that is off by a constant leans the thrust with it, and blows a wind that was not there: with drag of
0.25 1/s a milliradian is 0.04 m/s. Equations leave out what rotors really do (inflow, sampling of their commands
between log lines); what that comes to on craft of known truth is added to what the fit says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.units import STANDARD_GRAVITY
from sysid.records.experiment import Floats
from sysid.records.motor_scaling import EXPO_SIGMA
from sysid.rigid_body.body_motion import LAG, OWN, SHARED, THETA, BodyMotion, velocity_increments
from sysid.rigid_body.filter_error import FilterErrorFit, Prior, flight_slice, inverted
from sysid.statistics.covariance import wander

#: Part of the whole drag at the usual speed along an axis by which the laws of drag misrepresent it: half of the
#: variance is linear, half quadratic.
DRAG_PART = 0.02

#: Time by which attitude, thrust and velocity of a log may be apart, s. A swing at w 1/s then shows in phase with its
#: velocity, as drag of w^2 times this: nothing on legs, half of the drag where a craft is only shaken.
APART = 0.002

#: Part of the variance of the attitude's error that goes with the craft, with north, and with the speed, each.
ATTITUDE_PART = 1.0 / 3.0

#: What the equations of thrust misrepresent: inflow that differs between motors in climb, s/m, and slew and lag of
#: motors that are not of first order, s (4 ms root mean square on firmware craft).
CLIMB_FORM, LAG_FORM = 0.003, 0.006

#: Part by which the steepness of thrust over command errs: commands between the lines of a log (10 Hz) are smoother
#: than they were (straight lines take a tenth of a swing at 2 Hz), while the craft answered to all of them.
STEEPNESS = 0.01

#: Place of the curvature among the parameters.
EXPO = THETA.index("thrust_expo")

#: Time over which a command's own mean is left out where its variation counts, s, and time of correlation beyond which
#: gusts are too slow for the height controller to answer as to news, s.
ANSWER_SECONDS, SLOW_GUSTS = 10.0, 3.0


def with_shared_errors(motions: Sequence[BodyMotion], fit: FilterErrorFit, law: int, prior: Prior) -> FilterErrorFit:
    """Return the fit with thrust in the air of its flights, and what their inputs hide in its covariance.

    What another flight adds, and these do not show, stands beside it.
    """
    places, part, to_their_air = np.arange(SHARED), folded(motions, fit.values), np.eye(len(fit.values))
    to_their_air[0, SHARED + OWN.index("thrust_scale") :: len(OWN) + 2] = fit.values[0] / len(motions)
    covariance = to_their_air @ fit.covariance @ to_their_air.T
    errors, others = form_and_attitude(motions, fit.values)
    errors[0] = _wandering(motions, fit.values, law) * fit.values[0]
    errors[LAG] = float(np.hypot(errors[LAG], part * max(motion.input_interval for motion in motions)))
    covariance[places, places] += errors**2
    return _with_curvature(motions, replace(fit, covariance=covariance, transfer=others**2), prior, part)


def _with_curvature(motions: Sequence[BodyMotion], fit: FilterErrorFit, prior: Prior, fold: float) -> FilterErrorFit:
    """Return the fit with its curvature weighed anew against that in the parameters.

    The fit weighed the two by the scatter within the flight, which shows nothing of errors that all of it shares: in
    hovers in gusts it took full thrust to be 11 % lower than it is.
    """
    value, setting, setting_weight = fit.values[EXPO], prior.mean[EXPO], prior.sigma[EXPO] ** -2.0
    scatter = _curvature_variance(fit, prior)
    alone = 1.0 / max(1.0 / scatter - setting_weight, 1e-9)  # The variance by the flight without the setting.
    flown = value + alone * setting_weight * (value - setting)
    between_laws = max(fit.covariance[EXPO, EXPO] - scatter, 0.0)
    alone += between_laws + _curvature_sigma(motions, fit, fold) ** 2
    variance = 1.0 / (1.0 / alone + setting_weight)
    expo = float(np.clip(setting + variance / alone * (flown - setting), prior.low[EXPO], prior.high[EXPO]))
    apart, bent = expo - setting, _bent(motions, fit.values)
    contradicted = prior.sigma[EXPO] >= EXPO_SIGMA and apart**2 >= 9.0 * variance
    at_a_curve = np.eye(len(bent)) - np.outer(bent, np.arange(len(bent)) == EXPO)
    return replace(
        fit,
        values=fit.values + bent * (expo - value),
        covariance=at_a_curve @ fit.covariance @ at_a_curve.T + np.outer(bent, bent) * variance,
        halfway=0.5 * apart * bent[:SHARED] * contradicted,
    )


def _curvature_variance(fit: FilterErrorFit, prior: Prior) -> float:
    """Variance of the curvature by the scatter within flights and by the parameters, under one law of drag."""
    return float(inverted(fit.information + np.diag(prior.sigma**-2.0))[EXPO, EXPO])


def _wandering(motions: Sequence[BodyMotion], values: Floats, law: int) -> float:
    """Part by which the mean of thrust wanders beside what the equations make of its commands, of wind and of drag.

    With the battery and the propellers, over half minutes, by several percent on real flights: gusts pass within
    seconds, so that the filter does not count it.
    """
    left = []
    for flight, motion in enumerate(motions):
        theta = np.concatenate([values[:SHARED], values[flight_slice(flight)]])
        changes = velocity_increments(motion, theta, law)
        left.append(changes.missed[:, 2] / changes.seconds)
    return wander(np.concatenate(left)) / STANDARD_GRAVITY


def form_and_attitude(motions: Sequence[BodyMotion], values: Floats) -> tuple[Floats, Floats]:
    """Compute standard deviations of errors of laws and attitude: on these flights, and on others; (SHARED,) each."""
    here, others = np.zeros(SHARED), np.zeros(SHARED)
    here[LAG], others[THETA.index("climb_loss")] = LAG_FORM, CLIMB_FORM
    # Estimators start anew in each flight: their errors average.
    tilt = np.sqrt(ATTITUDE_PART * np.mean([np.mean(m.attitude_sigma[:2] ** 2) for m in motions]) / len(motions))
    here[[THETA.index("tilt_x"), THETA.index("tilt_y")]] = tilt
    for place, axis in enumerate("xyz"):
        speed = max(usual_speed(motions, place), 0.3)
        linear, square = (THETA.index(f"drag_{law}_{axis}") for law in ("linear", "quadratic"))
        drag = DRAG_PART * (values[linear] * speed + values[square] * speed**2)
        # An error of attitude that goes with the speed, by an unknown part of it between -1 and 1, is drag.
        leant = STANDARD_GRAVITY * tilt * np.sqrt(len(motions) / 3.0) / speed if axis != "z" else 0.0
        here[linear] = np.hypot(APART * _swing(motions, place) ** 2, leant)
        others[linear], others[square] = np.sqrt(0.5) * drag / speed, np.sqrt(0.5) * drag / speed**2
    return here, others


def _swing(motions: Sequence[BodyMotion], axis: int) -> float:
    """Acceleration over speed about their means along a body axis, 1/s: at which frequency the craft swings."""
    speeds = [np.einsum("ni,ni->n", m.rotation[:, :, axis], m.velocity) for m in motions]
    pushes = [np.gradient(speed, m.dt) for speed, m in zip(speeds, motions, strict=True)]
    moved, pushed = (sum(float(np.var(signal)) * len(signal) for signal in part) for part in (speeds, pushes))
    return float(np.sqrt(pushed / moved)) if moved > 0.0 else 0.0


def answered(motions: Sequence[BodyMotion], fit: FilterErrorFit) -> float:
    """Part of the thrust's variation that may be the height controller's answer to gusts.

    An answer opposes what it answers to, and makes commands look less steep (and later) than they are by as much: the
    bias of direct identification in closed loop (Ljung 1999, section 13.4), where the disturbance is not quite of the
    kind that the fit takes it for. In hovers in gusty wind it came to 10 to 30 %.
    """
    gusts, varied = 0.0, 0.0
    for motion, (_, vertical) in zip(motions, fit.disturbances, strict=True):
        pull = _varying(motion, fit.values)
        gusts += len(pull) * vertical.gust**2 / (1.0 + vertical.tau / SLOW_GUSTS)
        varied += float(np.sum(pull**2))
    return min(gusts / max(varied, 1e-12), 1.0)


def folded(motions: Sequence[BodyMotion], values: Floats) -> float:
    """Part of the thrust's variation that is faster than rows of motor outputs show, and folds into what they show.

    A point every tenth of a second of a command that answers to noise is noise itself, with a spectrum that does not
    fall off towards the end of its band. Thrust does not go with it: commands look less steep, and later, than they are
    (errors in variables). In hovers in gusts that came to 20 to 30 %, and 40 ms; spark404 and log_0036 were told that
    their MOT_THST_EXPO is not as set.
    """
    fold, whole = 0.0, 0.0
    for motion in motions:
        every = round(motion.input_interval / motion.dt)
        rows = _varying(motion, values)[:: max(every, 1)]
        power = np.abs(np.fft.rfft(rows * np.hanning(len(rows)))) ** 2
        # The upper fifth of the band tells the power of the folded part.
        fold += float(power[round(0.8 * len(power)) :].mean()) * len(power)
        whole += float(power.sum())
    return min(fold / max(whole, 1e-12), 1.0)


def _varying(motion: BodyMotion, values: Floats) -> Floats:
    """Thrust per mass by its commands, about its mean over `ANSWER_SECONDS`, m/s^2; shape (N,)."""
    thrust, expo = (values[THETA.index(name)] for name in ("thrust", "thrust_expo"))
    pull = motion.density * ((1.0 - expo) * motion.linear + expo * motion.square) * thrust
    size = min(round(ANSWER_SECONDS / motion.dt), len(pull) - 1) | 1
    around = np.pad(pull, size // 2, mode="reflect")
    return np.asarray(pull - np.convolve(around, np.full(size, 1.0 / size), mode="valid"))


def _bent(motions: Sequence[BodyMotion], values: Floats) -> Floats:
    """Return what changes with the curvature, and by how much, where thrust at the usual command stays, (n,)."""
    command, part = _usual_command(motions, values)
    bent = np.zeros(len(values))
    bent[[THETA.index("thrust"), EXPO]] = values[THETA.index("thrust")] * (1.0 - command) / part, 1.0
    return bent


def _curvature_sigma(motions: Sequence[BodyMotion], fit: FilterErrorFit, fold: float) -> float:
    """Compute what errors of the steepness d ln T / d ln c = (1 - e + 2 e c) / (1 - e + e c) make of the curvature e.

    They are `STEEPNESS`, the part of the commands that answers to gusts (`answered`) and the part `fold` that is noise
    (`folded`), all of which lacks in steepness where none of the thrust went with it.
    """
    command, part = _usual_command(motions, fit.values)
    steepness = np.linalg.norm((STEEPNESS, answered(motions, fit), fold))
    return float(steepness * part**2 / max(command, 1e-9))


def _usual_command(motions: Sequence[BodyMotion], values: Floats) -> tuple[float, float]:
    """Return the usual command c and its thrust 1 - e + e c, over that of a straight curve."""
    linear, square = (
        float(np.concatenate([getattr(m, name) for m in motions]).mean()) for name in ("linear", "square")
    )
    command = square / max(linear, 1e-9)
    return command, float(1.0 - values[EXPO] + values[EXPO] * command)


def usual_speed(motions: Sequence[BodyMotion], axis: int) -> float:
    """Root mean square of the speed along a body axis over the ground, m/s."""
    along = [np.einsum("ni,ni->n", motion.rotation[:, :, axis], motion.velocity) for motion in motions]
    return float(np.sqrt(np.mean(np.concatenate(along) ** 2)))


def wind_error(motion: BodyMotion, wind: Floats, drag: float) -> float:
    """Compute the standard deviation of each component of a wind that the attitude's error makes, m/s.

    Shapes: `wind` (2,).
    """
    lean = STANDARD_GRAVITY * float(np.sqrt(ATTITUDE_PART * np.mean(motion.attitude_sigma[:2] ** 2))) / max(drag, 1e-6)
    turned = float(np.hypot(*wind)) * float(motion.attitude_sigma[2])
    return float(np.hypot(lean, turned))
