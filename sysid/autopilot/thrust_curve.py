"""Thrust curve and hover throttle of the motors' commands, as ArduPilot's parameters say them.

ArduPilot makes of a thrust t the command c with t = (1 - e) c + e c^2, e = MOT_THST_EXPO, between MOT_SPIN_MIN (c = 0)
and MOT_SPIN_MAX (c = 1) (AP_MotorsMulticopter). Where the motors follow another curve f than the parameters' g, a
unit of the controllers' outputs gives f'(c) / g'(c) of the thrust that it should: the gain of the loops changes with
throttle. Hover alone does not tell the curve, since MOT_THST_HOVER hides it; climbs and descents do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.parameter import Parameter
from logparse import FlightLog, Vehicle
from logparse.tables import between
from sysid.autopilot.values import AutopilotValue, ParameterFile, decided, refused
from sysid.loops.parameter_file import typed
from sysid.records.experiment import Experiment, Floats
from sysid.records.mixer import MIXER_DIFFERS
from sysid.records.motor_scaling import curve, motor_commands
from sysid.rigid_body.body_motion import motion
from sysid.rigid_body.model import RigidBodyModel
from sysid.statistics.covariance import autocovariance, coloured_information

NAMES = ("MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_THST_HOVER")

#: Terms of the vertical loop over hover throttle: a unit of throttle accelerates by g over that of hover, and
#: PSC_ACCZ_P is throttle for 10 m/s^2 (AC_PosControl), PSC_D_ACC_P, as it is called since ArduCopter 4.7, for 1 m/s^2.
_CLIMB = {
    "PSC_ACCZ_P": (1.0, "the throttle of hover: an error of acceleration is met by the throttle that cancels it"),
    "PSC_ACCZ_I": (2.0, "twice PSC_ACCZ_P"),
    "PSC_D_ACC_P": (0.1, "a tenth of the throttle of hover: it meets an error of 1 m/s^2"),
    "PSC_D_ACC_I": (0.2, "twice PSC_D_ACC_P"),
}

#: Largest sigma of a curvature, and of the command at which thrust begins, that are set.
_EXPO_SIGMA, _BEGIN_SIGMA = 0.05, 0.02

#: Standard deviations beyond which a departure is one, and the command at which thrust clearly begins elsewhere than
#: MOT_SPIN_MIN says: a battery that sags with throttle feigns 0.04 (`octa11_auto_8kg`).
_CLEARLY, _NOTICED = 4.0, 0.05

#: Change of the loops' gain over the thrust flown for which no curve is changed unless it is clearly another: hover
#: with small climbs errs by 3.1 standard deviations where the accelerometer folds vibration (`vibration_octa8_off`).
_SAME_GAIN = 0.03

#: Change of the curve that goes with a change of where thrust begins, which is not known as well as its sigma says
#: (`expo_quad15_right` read with MOT_SPIN_MIN 0.20 and 0.25).
_BENDS = 10.0

#: Hover: vertical speed below, m/s, lean below, rad; shortest time of it, s; change of throttle from first to last
#: third that is a battery's.
_STILL, _UPRIGHT, _SHORTEST, _SAGGED = 0.3, 0.1, 5.0, 0.05


def thrust_values(
    model: RigidBodyModel, logs: Sequence[FlightLog], records: Sequence[Experiment], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return thrust curve and hover throttle, or why not; the throttle of hover is that of the curve proposed."""
    apart = next((finding for record in records for finding in record.findings if finding.id == MIXER_DIFFERS), None)
    if apart is not None:
        return refused(NAMES, ParameterFile.ESC, flown, f"parameters did not fly: {apart.reason}")
    vehicle = model.vehicle
    meant, sigma, begin_sigma = believed(model, records)
    width = vehicle.spin_max - vehicle.spin_min
    pulses = np.concatenate([record.u.mean(axis=1) for record in records])
    low, usual, high = np.percentile(pulses, [1.0, 50.0, 99.0])
    if not sigma <= _EXPO_SIGMA:
        why = model.parameters["thrust_expo"].reason or f"its sigma is {sigma:.2f}; climb and descend with vigour"
        curves = refused(NAMES[:2], ParameterFile.ESC, flown, why)
    else:
        ratio = _slopes(np.array([low, usual, high]), meant) / _slopes(np.array([low, usual, high]), vehicle)
        least, highest = ratio[[0, 2]] / ratio[1] - 1.0
        reason = (
            f"as flown a unit of the controllers' outputs gives {100.0 * least:+.0f} % at the least and "
            f"{100.0 * highest:+.0f} % at the highest thrust flown; with this curve the rate gains act "
            f"{100.0 * (1.0 / ratio[1] - 1.0):+.0f} % in hover"
        )
        parameters = {NAMES[0]: Parameter(meant.thrust_expo, sigma, "", reason)}
        moved = meant.spin_min != vehicle.spin_min
        if moved:
            parameters[NAMES[1]] = Parameter(
                meant.spin_min, begin_sigma * width, "", "where thrust begins, with this curve"
            )
        curves = decided(parameters, ParameterFile.ESC, flown)
        clear = abs(meant.thrust_expo - vehicle.thrust_expo) > _CLEARLY * sigma
        if not clear and max(abs(least), abs(highest)) < _SAME_GAIN and _proposed(curves):
            why = f"{parameters[NAMES[0]]} changes the loops' gain by less than {100.0 * _SAME_GAIN:.0f} % as flown"
            curves = refused(NAMES[:1], ParameterFile.ESC, flown, why)
        if not moved or not _proposed(curves):
            known = begin_sigma <= _BEGIN_SIGMA
            how = (
                "thrust begins where it says" if known else "where thrust begins only vigorous climbs and descents tell"
            )
            why = f"{how}: ± {min(begin_sigma, 1.0) * width:.3f}"
            curves = curves[:1] + refused(NAMES[1:2], ParameterFile.ESC, flown, why, right=known)
    changed = _proposed(curves)
    scale = float(_thrust(usual, meant) / _thrust(usual, vehicle)) if changed else 1.0
    # A hover throttle of the new curve is loaded with it: alone it would be wrong.
    return [*curves, *_hover(logs, records, flown, scale, ParameterFile.ESC if changed else ParameterFile.THROTTLE)]


def _proposed(values: Sequence[AutopilotValue]) -> bool:
    return any(value.proposed.value is not None for value in values)


def believed(model: RigidBodyModel, records: Sequence[Experiment]) -> tuple[Vehicle, float, float]:
    """Return the craft with the curve that its motors follow, its sigma, and that of the command where thrust begins.

    Along the thrust the craft feels ``a + b c + d c^2`` a motor, so that a is zero where MOT_SPIN_MIN is right.
    """
    vehicle, place = model.vehicle, model.estimated.index("thrust_expo")
    # Where thrust begins is looked at here: that the parameters may be right beside the flight is no error of it.
    expo, sigma = model.value("thrust_expo"), float(np.sqrt(model.covariance[place, place] - model.contradicted**2))
    regressors, felt = zip(*[_along_thrust(model, record) for record in records], strict=True)
    every, forces = np.concatenate(regressors), np.concatenate(felt)
    inverse = np.linalg.pinv(every.T @ every)
    a, b, d = inverse @ every.T @ forces
    left = [force - part @ (a, b, d) for part, force in zip(regressors, felt, strict=True)]
    covariance = inverse @ coloured_information(regressors, autocovariance(left, 20)) @ inverse
    slope = b * b - 4.0 * a * d
    if not (b > 0.0 and slope > 0.0):
        return replace(vehicle, thrust_expo=expo), sigma, np.inf
    begin, begin_sigma = -2.0 * a / (b + np.sqrt(slope)), float(np.sqrt(covariance[0, 0]) / b)
    spin = vehicle.spin_min + begin * (vehicle.spin_max - vehicle.spin_min)
    if begin_sigma > _BEGIN_SIGMA or abs(begin) < max(_CLEARLY * begin_sigma, _NOTICED) or not 0.0 < spin < 0.5:
        # What is not believed of the departure is an error of it.
        return replace(vehicle, thrust_expo=expo), sigma, float(np.hypot(begin_sigma, begin))
    straight, bent = b + 2.0 * d * begin, d * (1.0 - begin)
    meant = replace(vehicle, spin_min=float(spin), thrust_expo=float(bent / (straight + bent)))
    return meant, float(np.hypot(sigma, _BENDS * begin_sigma)), begin_sigma


def _along_thrust(model: RigidBodyModel, record: Experiment) -> tuple[Floats, Floats]:
    """Return 1, c and c^2 summed over the motors (K, 3), and the specific force but for drag (K,), in sea-level air."""
    flight = motion(record, model.vehicle, model.reference_voltage)
    rotation = flight.rotation
    # The wind is horizontal, and hardly felt along the thrust of a craft that leans little.
    down = np.einsum("ni,ni->n", rotation[:, :, 2], flight.velocity)
    linear = np.sqrt(flight.density) if model.rotor_drag else flight.density
    drag = model.value("drag_linear_z") * linear * down + flight.density * (
        model.value("drag_quadratic_z") * np.abs(down) * down - model.value("climb_loss") * np.minimum(down, 0.0) ** 2
    )
    assert record.context is not None  # the rigid body was fitted to it
    felt = (-record.context["f_z"].to_numpy(np.float64) - drag) / flight.density
    ones = np.full(len(felt), float(record.u.shape[1]))
    columns = np.column_stack([ones, flight.linear, flight.square, felt])
    size = max(round(0.5 / flight.dt), 1)
    means = columns[: len(columns) // size * size].reshape(-1, size, 4).mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    return means[:, :3], means[:, 3]


def _thrust(pulses: Floats, vehicle: Vehicle) -> Floats:
    """Return the thrust over the full one of motors at pulses [us], by a craft's curve."""
    return curve(motor_commands(np.asarray(pulses), vehicle), vehicle.thrust_expo)


def _slopes(pulses: Floats, vehicle: Vehicle) -> Floats:
    """Return by how much thrust rises with the pulse."""
    return np.asarray(_thrust(pulses + 1.0, vehicle) - _thrust(pulses - 1.0, vehicle))


def _hover(
    logs: Sequence[FlightLog],
    records: Sequence[Experiment],
    flown: Mapping[str, float],
    scale: float,
    file: ParameterFile,
) -> list[AutopilotValue]:
    """Return the throttle of hover by the curve that will fly, `scale` times what it was."""

    def no(why: str) -> list[AutopilotValue]:
        return refused(NAMES[2:], file, flown, why)

    throttles = []
    for log, record in zip(logs, records, strict=True):
        throttle = hover_throttle(log, record)
        if len(throttle) < _SHORTEST:
            continue
        third = len(throttle) // 3
        first, last = float(np.median(throttle[:third])), float(np.median(throttle[-third:]))
        if abs(last / first - 1.0) > _SAGGED:
            cure = "" if log.vehicle.battery_voltage_max > 0.0 else "; set MOT_BAT_VOLT_MAX and MIN"
            return no(f"{log.name}: from first to last third hover took {first:.3f} to {last:.3f} of throttle{cure}")
        throttles.append(throttle)
    if not throttles:
        return no("no five seconds of hover (no climb, no lean) with the throttle output logged")
    together = np.concatenate(throttles)
    value, sigma = float(np.median(together)), float(np.std(together) / np.sqrt(len(throttles)))
    climb = {
        name: Parameter(part * scale * value, part * scale * sigma, "", why)
        for name, (part, why) in _CLIMB.items()
        if name in flown
    }
    climbs = decided(climb, ParameterFile.THROTTLE, flown) if climb else []
    if scale == 1.0:
        return [*decided({NAMES[2]: Parameter(value, sigma, "", "median of hover")}, file, flown), *climbs]
    how = f"goes with the new curve: median of hover ({value:.3f}) times {scale:.3f}"
    hover = Parameter(typed(scale * value), scale * sigma, "", how)
    return [AutopilotValue(NAMES[2], file, flown.get(NAMES[2]), hover), *climbs]


def hover_throttle(log: FlightLog, record: Experiment) -> Floats:
    """Return the throttle output of each second in which a flight hovered, 0..1."""
    given, context = log.tables.column("setpoints", "throttle"), record.context
    if given is None or context is None:
        return np.zeros(0)
    throttle = between(given, float(record.t[0]), float(record.t[-1])).dropna()
    t = throttle.index.to_numpy(np.float64)
    climb, roll, pitch = (np.interp(t, record.t, context[name]) for name in ("v_d", "roll", "pitch"))
    still = (np.abs(climb) < _STILL) & (np.hypot(roll, pitch) < _UPRIGHT)
    return np.asarray(throttle[still].groupby(np.floor(t[still])).mean(), np.float64)
