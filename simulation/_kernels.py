"""Compiled equations of motion, integrator and flight loop; plain arrays and named tuples of numbers.

State vector of a craft with n rotors: position (3, NED, m), velocity (3, NED, m/s), body-to-NED quaternion (4, scalar
first), angular rate (3, FRD, rad/s), rotor speeds (n, rad/s), and with drives of third order three states of each drive
(3 n). No fast-math, no BLAS and no vectorised transcendental functions on the way from seed to log: the same seed has
to give the same log, to the last bit.

One file on purpose: numba's cache notices a change in a function's own file only, not in the files that it calls.
"""

from math import asin, atan, atan2, cos, exp, inf, isfinite, pi, sin, sqrt, tan

import numpy as np

from core import compiled
from core.compiled import njit
from simulation._parameters import (
    AirframeParameters,
    AirParameters,
    AutopilotState,
    AxisParameters,
    AxisSignals,
    BladeParameters,
    CascadeParameters,
    CraftParameters,
    DriveParameters,
    Forcing,
    Instant,
    ResponseParameters,
    SensorParameters,
    TankParameters,
)
from simulation.atmosphere import GRAVITY, SEA_LEVEL_DENSITY

POSITION, VELOCITY, ATTITUDE, RATE, ROTORS = 0, 3, 6, 10, 13

#: Ends of a flight, as `fly_cascade` returns them.
COMPLETED, DIVERGED, OVERTURNED = 0, 1, 2

#: What the autopilot does, as recorded.
DISARMED, IDLE, FLYING, LANDING, LANDED = 0, 1, 2, 3, 4


#: For what only compiled code calls.
inner = compiled.inner(nogil=True, allocates=True)
#: The same for parts of the equations of motion: a call would copy the craft's parameters, about a hundred numbers.
part = compiled.inner(nogil=True)


@inner
def air_density(height: float, air: AirParameters) -> float:
    """Density [kg/m^3] at a height above the origin [m], constant lapse rate."""
    ratio = max(1.0 - air.lapse_rate * height / air.temperature, 1e-3)
    density: float = air.density * ratio**air.exponent
    return density


@inner
def rotation_matrix(q: np.ndarray, C: np.ndarray) -> None:
    """Fill C (3, 3), body to NED, from the quaternion q (4,), scalar first."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    C[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    C[0, 1] = 2.0 * (x * y - w * z)
    C[0, 2] = 2.0 * (x * z + w * y)
    C[1, 0] = 2.0 * (x * y + w * z)
    C[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    C[1, 2] = 2.0 * (y * z - w * x)
    C[2, 0] = 2.0 * (x * z - w * y)
    C[2, 1] = 2.0 * (y * z + w * x)
    C[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True, nogil=True)
def induced_velocity(
    speed: float, in_plane_squared: float, axial: float, density: float, blade: BladeParameters
) -> tuple[float, float]:
    """Solve blade-element and momentum thrust for one another (Guntur 2019, appendix A).

    `axial` is the rotor's velocity through the air against its thrust (positive sinking), `in_plane_squared` the
    square of the velocity across it. The momentum side grows from zero with v and the blade side falls to zero at
    ``end``, so a root lies between; Newton steps, bisection where they leave the bracket.
    """
    if blade.radius * speed < 1e-3:
        return 0.0, 0.0
    tip = speed * blade.radius
    factor = 0.25 * density * blade.lift * blade.radius
    still = factor * (
        axial * tip
        + 2.0 / 3.0 * tip * tip * (blade.theta0 + 0.75 * blade.theta1)
        + in_plane_squared * (blade.theta0 + 0.5 * blade.theta1)
    )
    slope = factor * tip
    end = still / slope
    low, high = min(0.0, end), max(0.0, end)
    flow = 2.0 * blade.efficiency * density * blade.area
    # Purely axial flow has a closed form, from which Newton needs a step or two.
    linear = slope - flow * axial
    v = (sqrt(linear * linear + 4.0 * flow * abs(still)) - linear) / (2.0 * flow)
    if not low < v < high:
        v = 0.5 * end
    for _ in range(60):
        through = sqrt(in_plane_squared + (axial - v) * (axial - v))
        residual = flow * v * through - (still - slope * v)
        if residual > 0.0:
            high = v
        else:
            low = v
        change = slope + flow * through
        if through > 1e-9:
            change += flow * v * (v - axial) / through
        new = v - residual / change if change > 0.0 else low
        # The error after a Newton step is of the order of the step's square.
        tolerance = 1e-7 * abs(end)
        if not low < new < high:
            new = 0.5 * (low + high)
            tolerance = 1e-12 * abs(end)
        settled = abs(new - v) <= tolerance
        v = new
        if settled:
            break
    return v, still - slope * v


@part
def rotor_response(x: np.ndarray, command: np.ndarray, response: ResponseParameters, n: int, dx: np.ndarray) -> None:
    """Fill dx with the changes of the n rotor speeds and of the drives' own states.

    Third order: z is the response of 1 / (a3 s^3 + a2 s^2 + a1 s + 1) and its two derivatives; the rotor turns with
    z + T z' as long as speed and acceleration stay within their limits, and afterwards catches up.
    """
    if response.coefficients.size == 0:
        for i in range(n):
            dx[ROTORS + i] = (command[i] - x[ROTORS + i]) / response.time_constant
        return
    T, a1, a2, a3 = response.coefficients
    limit = response.acceleration_limit
    for i in range(n):
        j = ROTORS + n + 3 * i
        z0, z1, z2 = x[j], x[j + 1], x[j + 2]
        order = min(max(command[i], 0.0), response.speed_limit)
        dx[j], dx[j + 1], dx[j + 2] = z1, z2, (order - z0 - a1 * z1 - a2 * z2) / a3
        w = x[ROTORS + i]
        change = z1 + T * z2 + (z0 + T * z1 - w) / response.time_constant
        change = min(max(change, -limit), limit)
        if (w >= response.speed_limit and change > 0.0) or (w <= 0.0 and change < 0.0):
            change = 0.0
        dx[ROTORS + i] = change


@part
def rotor_loads(
    x: np.ndarray,
    u: float,
    v: float,
    s: float,
    density: float,
    frame: AirframeParameters,
    dx: np.ndarray,
    load: np.ndarray,
) -> None:
    """Add to `load` (7,) force, moment and shaft power of all rotors; body moves with (u, v, s) through the air.

    Thrust acts upwards; the reaction torque turns the body against the rotor, as does what speeds the rotor up, and the
    momentum of the rotors makes a gyroscopic moment. `dx` holds the rotors' accelerations already.
    """
    relative = density / SEA_LEVEL_DENSITY
    wx, wy, wz = x[RATE], x[RATE + 1], x[RATE + 2]
    lift, mx, my, mz, power, momentum = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(frame.rotor_spin.size):
        w = x[ROTORS + i]
        px, py, pz = frame.rotor_position[i, 0], frame.rotor_position[i, 1], frame.rotor_position[i, 2]
        if frame.blade.radius > 0.0:
            lu, lv, ls = u + wy * pz - wz * py, v + wz * px - wx * pz, s + wx * py - wy * px
            inflow, thrust = induced_velocity(w, lu * lu + lv * lv, ls, density, frame.blade)
            torque = thrust * (inflow - ls) / max(w, 1.0)
        else:
            thrust = relative * frame.thrust_coefficient[i] * w * w
            torque = relative * frame.torque_coefficient[i] * w * w
        power += torque * w
        momentum += frame.rotor_spin[i] * frame.rotor_inertia[i] * w
        lift += thrust
        mx -= thrust * py
        my += thrust * px
        mz -= frame.rotor_spin[i] * (torque + frame.rotor_inertia[i] * dx[ROTORS + i])
    load[0], load[1], load[2], load[6] = 0.0, 0.0, -lift, power
    load[3], load[4], load[5] = mx - wy * momentum, my + wx * momentum, mz


@part
def ground_loads(x: np.ndarray, C: np.ndarray, frame: AirframeParameters, load: np.ndarray) -> None:
    """Add to `load` (7,) what the feet feel: spring and damper upwards, Coulomb friction smoothed below 2 cm/s."""
    wx, wy, wz = x[RATE], x[RATE + 1], x[RATE + 2]
    for j in range(frame.feet.shape[0]):
        rx, ry, rz = frame.feet[j, 0], frame.feet[j, 1], frame.feet[j, 2]
        depth = x[2] + C[2, 0] * rx + C[2, 1] * ry + C[2, 2] * rz - frame.ground
        if depth > 0.0:
            bx, by, bz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
            sn = x[VELOCITY] + C[0, 0] * bx + C[0, 1] * by + C[0, 2] * bz
            se = x[VELOCITY + 1] + C[1, 0] * bx + C[1, 1] * by + C[1, 2] * bz
            sd = x[VELOCITY + 2] + C[2, 0] * bx + C[2, 1] * by + C[2, 2] * bz
            normal = max(0.0, frame.foot_stiffness * depth + frame.foot_damping * sd)
            grip = frame.friction * normal / sqrt(sn * sn + se * se + 0.02 * 0.02)
            gn, ge, gd = -grip * sn, -grip * se, -normal
            gx = C[0, 0] * gn + C[1, 0] * ge + C[2, 0] * gd
            gy = C[0, 1] * gn + C[1, 1] * ge + C[2, 1] * gd
            gz = C[0, 2] * gn + C[1, 2] * ge + C[2, 2] * gd
            load[0] += gx
            load[1] += gy
            load[2] += gz
            load[3] += ry * gz - rz * gy
            load[4] += rz * gx - rx * gz
            load[5] += rx * gy - ry * gx


@inner
def derivative(
    x: np.ndarray,
    command: np.ndarray,
    wind: np.ndarray,
    frame: AirframeParameters,
    air: AirParameters,
    dx: np.ndarray,
    load: np.ndarray,
) -> None:
    """Newton-Euler equations of a multirotor on or above flat ground.

    Fills dx (as x) for commanded rotor speeds (n,) [rad/s] and a wind (3,), NED, and `load` (7,): force [N] and moment
    [N m] on the body, body axes, without gravity, and the power at the rotors' shafts [W].
    """
    C = np.empty((3, 3))
    rotation_matrix(x[ATTITUDE:RATE], C)
    density = air_density(-x[2], air)

    # Velocity through the air in body axes.
    vn, ve, vd = x[VELOCITY] - wind[0], x[VELOCITY + 1] - wind[1], x[VELOCITY + 2] - wind[2]
    u = C[0, 0] * vn + C[1, 0] * ve + C[2, 0] * vd
    v = C[0, 1] * vn + C[1, 1] * ve + C[2, 1] * vd
    s = C[0, 2] * vn + C[1, 2] * ve + C[2, 2] * vd

    rotor_response(x, command, frame.response, frame.rotor_spin.size, dx)
    rotor_loads(x, u, v, s, density, frame, dx, load)

    # Drag in body axes: linear (rotor and induced drag) and quadratic (airframe), both proportional to density.
    relative = density / SEA_LEVEL_DENSITY
    half = 0.5 * density * sqrt(u * u + v * v + s * s)
    load[0] -= (relative * frame.drag_linear[0] + half * frame.drag_area[0]) * u
    load[1] -= (relative * frame.drag_linear[1] + half * frame.drag_area[1]) * v
    load[2] -= (relative * frame.drag_linear[2] + half * frame.drag_area[2]) * s
    ground_loads(x, C, frame, load)

    for i in range(3):
        dx[POSITION + i] = x[VELOCITY + i]
        dx[VELOCITY + i] = (C[i, 0] * load[0] + C[i, 1] * load[1] + C[i, 2] * load[2]) / frame.mass[0]
    dx[VELOCITY + 2] += frame.gravity

    wx, wy, wz = x[RATE], x[RATE + 1], x[RATE + 2]
    qw, qx, qy, qz = x[ATTITUDE], x[ATTITUDE + 1], x[ATTITUDE + 2], x[ATTITUDE + 3]
    dx[ATTITUDE] = 0.5 * (-qx * wx - qy * wy - qz * wz)
    dx[ATTITUDE + 1] = 0.5 * (qw * wx + qy * wz - qz * wy)
    dx[ATTITUDE + 2] = 0.5 * (qw * wy - qx * wz + qz * wx)
    dx[ATTITUDE + 3] = 0.5 * (qw * wz + qx * wy - qy * wx)

    J = frame.inertia
    hx = J[0, 0] * wx + J[0, 1] * wy + J[0, 2] * wz
    hy = J[1, 0] * wx + J[1, 1] * wy + J[1, 2] * wz
    hz = J[2, 0] * wx + J[2, 1] * wy + J[2, 2] * wz
    mx = load[3] - (wy * hz - wz * hy)
    my = load[4] - (wz * hx - wx * hz)
    mz = load[5] - (wx * hy - wy * hx)
    for i in range(3):
        dx[RATE + i] = (
            frame.inertia_inverse[i, 0] * mx + frame.inertia_inverse[i, 1] * my + frame.inertia_inverse[i, 2] * mz
        )


@part
def discharge(t: float, frame: AirframeParameters) -> None:
    """Set mass and inertia of a craft whose tank empties to those at t [s], linear between the tank's entries.

    What flows out takes no momentum along (Guntur 2019 assumes the same).
    """
    tank: TankParameters = frame.tank
    last = tank.time.size - 1
    if last < 1:
        return
    k = 0
    while k < last - 1 and tank.time[k + 1] <= t:
        k += 1
    share = min(max((t - tank.time[k]) / (tank.time[k + 1] - tank.time[k]), 0.0), 1.0)
    frame.mass[0] = tank.mass[k] + share * (tank.mass[k + 1] - tank.mass[k])
    J, K = frame.inertia, frame.inertia_inverse
    for i in range(3):
        for j in range(3):
            J[i, j] = tank.inertia[k, i, j] + share * (tank.inertia[k + 1, i, j] - tank.inertia[k, i, j])
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            K[j, i] = J[a, c] * J[b, d] - J[a, d] * J[b, c]
    determinant = J[0, 0] * K[0, 0] + J[0, 1] * K[1, 0] + J[0, 2] * K[2, 0]
    for i in range(3):
        for j in range(3):
            K[i, j] /= determinant


@inner
def rk4_step(
    x: np.ndarray,
    command: np.ndarray,
    wind: np.ndarray,
    dt: float,
    frame: AirframeParameters,
    air: AirParameters,
    work: np.ndarray,
) -> None:
    """Advance x in place by one step of the classical fourth-order Runge-Kutta method.

    `work` (5, size of x) is scratch; its first row must already hold the derivative at x.
    """
    load = np.empty(7)
    k1, k2, k3, k4, stage = work[0], work[1], work[2], work[3], work[4]
    n = x.size
    for i in range(n):
        stage[i] = x[i] + 0.5 * dt * k1[i]
    derivative(stage, command, wind, frame, air, k2, load)
    for i in range(n):
        stage[i] = x[i] + 0.5 * dt * k2[i]
    derivative(stage, command, wind, frame, air, k3, load)
    for i in range(n):
        stage[i] = x[i] + dt * k3[i]
    derivative(stage, command, wind, frame, air, k4, load)
    for i in range(n):
        x[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    normalise(x)


@inner
def normalise(x: np.ndarray) -> None:
    """Normalise the quaternion of a state."""
    norm = sqrt(x[6] * x[6] + x[7] * x[7] + x[8] * x[8] + x[9] * x[9])
    for i in range(ATTITUDE, RATE):
        x[i] /= norm


@inner
def put(row: np.ndarray, start: int, values: np.ndarray) -> None:
    """Copy `values` into `row` from `start` on; compiles in a tenth of the time of a slice assignment."""
    for i in range(values.size):
        row[start + i] = values[i]


@inner
def sensible(x: np.ndarray) -> bool:
    """Return whether a state is finite and within 1e6 m, 1e4 m/s and 1e4 rad/s."""
    for i in range(x.size):
        if not isfinite(x[i]):
            return False
    for i in range(3):
        if abs(x[i]) > 1e6 or abs(x[VELOCITY + i]) > 1e4 or abs(x[RATE + i]) > 1e4:
            return False
    return True


@njit(cache=True, nogil=True)
def propagate(
    x: np.ndarray,
    command: np.ndarray,
    wind: np.ndarray,
    t: float,
    dt: float,
    every: int,
    euler: bool,
    frame: AirframeParameters,
    air: AirParameters,
    states: np.ndarray,
) -> int:
    """Integrate from t with one command (n,) and one wind (3,) held, x in place.

    Each row of `states` is filled after `every` steps of dt, by Euler's method or the classical Runge-Kutta method.
    Returns the number of steps done, fewer than asked for if the state left every sensible range.
    """
    work = np.empty((5, x.size))
    load = np.empty(7)
    slope = work[0]
    steps: int = states.shape[0] * every
    for k in range(steps):
        discharge(t + k * dt, frame)
        derivative(x, command, wind, frame, air, slope, load)
        if euler:
            for i in range(x.size):
                x[i] += dt * slope[i]
            normalise(x)
        else:
            rk4_step(x, command, wind, dt, frame, air, work)
        if not sensible(x):
            return k
        if (k + 1) % every == 0:
            put(states[k // every], 0, x)
    return steps


@njit(cache=True, nogil=True)
def drive_speed(pwm: float, voltage: float, drive: DriveParameters) -> float:
    """Settled rotor speed [rad/s] for PWM [us] and voltage [V]; see `simulation.drive.Drive`."""
    a = min(max((pwm - drive.pwm_zero) / (drive.pwm_full - drive.pwm_zero), 0.0), 1.0)
    return drive.speed_max * voltage / drive.voltage_reference * sqrt((1.0 - drive.expo) * a + drive.expo * a * a)


@njit(cache=True, nogil=True)
def actuator(u: float, expo: float) -> float:
    """Invert the thrust curve ``u = (1 - e) a + e a^2`` for a in 0..1."""
    u = min(max(u, 0.0), 1.0)
    if expo < 1e-6:
        return u
    return (expo - 1.0 + sqrt((1.0 - expo) ** 2 + 4.0 * expo * u)) / (2.0 * expo)


@njit(cache=True, nogil=True)
def mix(throttle: float, roll: float, pitch: float, yaw: float, mixer: np.ndarray, u: np.ndarray) -> bool:
    """Allocate throttle and torque commands to normalised thrusts u (n,) in 0..1.

    Roll and pitch come first: yaw gets what they leave (but always a fifth of the range), then the throttle moves so
    that no motor has to leave its range, and what still does is cut. Returns whether anything was limited.
    """
    n = u.size
    room = 1.0
    for i in range(n):
        u[i] = roll * mixer[i, 0] + pitch * mixer[i, 1]
        if mixer[i, 2] != 0.0:
            up = yaw * mixer[i, 2] > 0.0
            margin = 1.0 - throttle - u[i] if up else throttle + u[i]
            room = min(room, max(margin, 0.0) / abs(mixer[i, 2]))
    room = max(room, 0.2)
    limited = abs(yaw) > room
    yaw = min(max(yaw, -room), room)
    low, high = 0.0, 0.0
    for i in range(n):
        u[i] += yaw * mixer[i, 2]
        low = min(low, u[i])
        high = max(high, u[i])
    if throttle + high > 1.0:
        throttle = max(1.0 - high, 0.0)
        limited = True
    if throttle + low < 0.0:
        throttle = min(-low, 1.0 - high)
        limited = True
    for i in range(n):
        u[i] = min(max(u[i] + throttle, 0.0), 1.0)
    return limited


@inner
def wrap(angle: float) -> float:
    """Wrap an angle into -pi..pi."""
    return (angle + pi) % (2.0 * pi) - pi


@inner
def pid(error: float, gains: np.ndarray, memory: np.ndarray, smoothing: float, dt: float, limit: float) -> float:
    """Advance a PID controller by dt; `memory` (3,) is its integral within `limit`, its smoothed slope, the last error.

    `gains` (3,) are P, I and D; a limit of 0 leaves the integral as it is.
    """
    memory[1] += smoothing * ((error - memory[2]) / dt - memory[1])
    memory[2] = error
    if limit > 0.0:
        memory[0] = min(max(memory[0] + gains[1] * error * dt, -limit), limit)
    output: float = gains[0] * error + memory[0] + gains[2] * memory[1]
    return output


@inner
def position_control(
    x: np.ndarray,
    upright: float,
    yaw: float,
    reference: np.ndarray,
    errors: np.ndarray,
    level: bool,
    limited: bool,
    dt: float,
    gravity: float,
    cascade: CascadeParameters,
    autopilot: AutopilotState,
) -> None:
    """Position P, velocity PID, then lean angles and throttle (Elhesasy 2024, eq. 21-24).

    `upright` is the cosine of the tilt, `yaw` the believed heading, `reference` (10,) and `errors` (9,) the rows of
    this tick, `level` whether it is to stay level wherever it drifts, `limited` whether the last allocation was cut
    (then nothing integrates).
    """
    smoothing = 1.0 - exp(-dt * 2.0 * pi * 5.0)
    velocity_target, accel_target = autopilot.velocity_target, autopilot.accel_target
    autopilot.thrust[3] = min(autopilot.thrust[3] + dt / 1.0, 1.0)  # spools up within a second
    flying = x[2] < -0.1
    for i in range(3):
        error = reference[i] - (x[i] + errors[i])
        velocity_target[i] = reference[3 + i] + cascade.position_p[i] * error
    horizontal = sqrt(velocity_target[0] ** 2 + velocity_target[1] ** 2)
    if horizontal > cascade.speed_limit[0]:
        velocity_target[0] *= cascade.speed_limit[0] / horizontal
        velocity_target[1] *= cascade.speed_limit[0] / horizontal
    velocity_target[2] = min(max(velocity_target[2], -cascade.speed_limit[1]), cascade.speed_limit[2])
    held = 0.0 if limited or level or not flying else inf
    for i in range(3):
        error = velocity_target[i] - (x[VELOCITY + i] + errors[3 + i])
        accel_target[i] = pid(error, cascade.velocity_pid[i], autopilot.velocity_memory[i], smoothing, dt, held)
    # Horizontal: the output is an acceleration; lean into it, yaw taken out.
    for i in range(2):
        accel_target[i] += reference[6 + i]
    cy, sy = cos(yaw), sin(yaw)
    forward = cy * accel_target[0] + sy * accel_target[1]
    right = -sy * accel_target[0] + cy * accel_target[1]
    limit = gravity * tan(cascade.tilt_limit)
    lean = sqrt(forward * forward + right * right)
    if lean > limit:
        forward *= limit / lean
        right *= limit / lean
    autopilot.angle_target[1] = -atan(forward / gravity)
    autopilot.angle_target[0] = atan(right * cos(autopilot.angle_target[1]) / gravity)
    if level:
        autopilot.angle_target[0], autopilot.angle_target[1] = 0.0, 0.0
    autopilot.angle_target[2] = reference[9]
    # Vertical: the output is normalised thrust about hover, more of it when tilted.
    throttle = cascade.hover_thrust * (1.0 - reference[8] / gravity) - accel_target[2]
    boost = throttle / max(upright, 0.5) - throttle
    accel_target[2] = -(throttle / cascade.hover_thrust - 1.0) * gravity
    autopilot.thrust[0] = throttle
    autopilot.thrust[1] = min(max((throttle + boost) * autopilot.thrust[3], 0.0), 1.0)
    autopilot.thrust[2] = boost


@inner
def stand_by(yaw: float, autopilot: AutopilotState) -> None:
    """Forget everything while the motors idle or stand; the heading to hold is the present one."""
    autopilot.velocity_memory[:] = 0.0
    autopilot.rate_memory[:] = 0.0
    for decision in (
        autopilot.velocity_target,
        autopilot.accel_target,
        autopilot.rate_target,
        autopilot.torque,
        autopilot.angle_target,
        autopilot.thrust,
    ):
        for i in range(decision.size):
            decision[i] = 0.0
    autopilot.angle_target[2] = yaw


@inner
def attitude_control(
    rate: np.ndarray, limited: bool, dt: float, cascade: CascadeParameters, autopilot: AutopilotState
) -> None:
    """Angle P, rate PID to normalised torques (Elhesasy 2024, eq. 18-20); `rate` (3,) is the measured rate."""
    smoothing = 1.0 - exp(-dt * 2.0 * pi * 20.0)
    spool = autopilot.thrust[3]
    held = 0.0 if limited or spool < 1.0 else inf
    for i in range(3):
        autopilot.rate_target[i] = cascade.angle_p[i] * wrap(autopilot.angle_target[i] - autopilot.angle[i])
        error = autopilot.rate_target[i] - rate[i]
        out = pid(error, cascade.rate_pid[i], autopilot.rate_memory[i], smoothing, dt, held)
        autopilot.torque[i] = min(max(out, -1.0), 1.0) * spool


@inner
def low_pass(frequency: float, dt: float) -> tuple[float, float, float]:
    """Second-order Butterworth low-pass by the bilinear transform: b0, a1, a2 (b1 = 2 b0, b2 = b0)."""
    ohm = tan(pi * frequency * dt)
    scale = 1.0 + sqrt(2.0) * ohm + ohm * ohm
    return ohm * ohm / scale, 2.0 * (ohm * ohm - 1.0) / scale, (1.0 - sqrt(2.0) * ohm + ohm * ohm) / scale


@inner
def sense_motion(
    x: np.ndarray,
    noise: np.ndarray,
    drift: np.ndarray,
    sensors: SensorParameters,
    coefficients: tuple[float, float, float],
    first: bool,
    now: Instant,
) -> int:
    """Measure rates and specific force behind their low-pass; return how many axes clipped.

    Broadband vibration grows with the square of the rotor speed; `drift` (6,) is what the biases have become on top
    of their constant parts. The filter starts in the steady state of the first sample.
    """
    b0, a1, a2 = coefficients
    measured, delays, n = now.measured, now.delays, now.pwm.size
    mean_square = 0.0
    for i in range(n):
        mean_square += x[ROTORS + i] * x[ROTORS + i] / n
    shake = mean_square / (sensors.vibration_speed * sensors.vibration_speed)
    clipped = 0
    for i in range(6):
        if i < 3:
            white = sensors.gyro_white + sensors.gyro_vibration * shake
            raw = x[RATE + i] + sensors.gyro_bias[i] + white * noise[i] + drift[i]
            reach = sensors.gyro_range
        else:
            white = sensors.accel_white + sensors.vibration * shake
            raw = now.specific_force[i - 3] + sensors.accel_bias[i - 3] + white * noise[i] + drift[i]
            reach = sensors.accel_range
        if abs(raw) > reach:
            raw = min(max(raw, -reach), reach)
            clipped += 1
        if first:
            delays[0, i] = raw / (1.0 + a1 + a2)
            delays[1, i] = delays[0, i]
        element = raw - a1 * delays[0, i] - a2 * delays[1, i]
        measured[i] = b0 * (element + 2.0 * delays[0, i] + delays[1, i])
        delays[1, i] = delays[0, i]
        delays[0, i] = element
    return clipped


@inner
def attitude_angles(C: np.ndarray, angles: np.ndarray) -> None:
    """Fill roll, pitch and yaw (3,) of a body-to-NED rotation."""
    angles[0] = atan2(C[2, 1], C[2, 2])
    angles[1] = -asin(min(max(C[2, 0], -1.0), 1.0))
    angles[2] = atan2(C[1, 0], C[0, 0])


@inner
def motor_outputs(
    state: int,
    excitation: np.ndarray,
    drive: DriveParameters,
    mixer: np.ndarray,
    autopilot: AutopilotState,
    pwm: np.ndarray,
) -> bool:
    """Fill the PWM (n,) [us] of the motors; return whether the allocation was limited.

    `excitation` (4,) is added at the mixer to the torques about roll, pitch, yaw and to the throttle.
    """
    n = pwm.size
    if state not in (FLYING, LANDING):
        for i in range(n):
            pwm[i] = drive.pwm_idle if state == IDLE else drive.pwm_min
        return False
    torque = autopilot.torque
    u = np.zeros(n)
    limited: bool = mix(
        autopilot.thrust[1] + excitation[3],
        torque[0] + excitation[0],
        torque[1] + excitation[1],
        torque[2] + excitation[2],
        mixer,
        u,
    )
    span = drive.pwm_full - drive.pwm_zero
    for i in range(n):
        pwm[i] = int(drive.pwm_zero + span * actuator(u[i], drive.expo))
    return limited


@inner
def draw(shaft_power: float, dt: float, drive: DriveParameters, pack: np.ndarray) -> None:
    """Advance the battery `pack` (3,): voltage [V] seen through 10 Hz, current [A] and charge drawn [A s].

    Taken is what the rotors take mechanically over the drives' efficiency.
    """
    power = drive.avionics_power + shaft_power / drive.efficiency
    pack[1] = power / max(pack[0], 1.0)
    pack[2] += pack[1] * dt
    full = max(1.0 - pack[2] / drive.capacity, 0.0)
    open_circuit = drive.voltage_empty + (drive.voltage_full - drive.voltage_empty) * full
    pack[0] += (open_circuit - pack[1] * drive.resistance - pack[0]) * min(dt * 2.0 * pi * 10.0, 1.0)


@inner
def record(
    row: np.ndarray,
    x: np.ndarray,
    acceleration: np.ndarray,
    wind: np.ndarray,
    excitation: np.ndarray,
    autopilot: AutopilotState,
    now: Instant,
) -> None:
    """Fill one row of a flight's records but for its time, state, clips and mass; see `simulation.fly.RECORD_COLUMNS`.

    What the autopilot puts out is what the mixer gets, `excitation` included, as ArduPilot logs it.
    """
    n = now.pwm.size
    put(row, 1, x[:ROTORS])
    put(row, 14, now.specific_force)
    put(row, 17, acceleration)
    put(row, 20, wind)
    put(row, 23, now.measured)
    put(row, 29, autopilot.angle_target)
    put(row, 32, autopilot.angle)
    put(row, 35, autopilot.rate_target)
    put(row, 38, autopilot.torque + excitation[:3])
    put(row, 41, autopilot.velocity_target)
    put(row, 44, autopilot.accel_target)
    put(row, 47, autopilot.thrust[:3])
    row[48] += excitation[3]
    put(row, 50, now.pack)
    put(row, 56, x[ROTORS : ROTORS + n])
    put(row, 56 + n, now.pwm)


@inner
def touched_down(x: np.ndarray) -> bool:
    """Return whether the craft stands nearly still on the ground."""
    return bool(x[2] > -0.05 and x[3] * x[3] + x[4] * x[4] + x[5] * x[5] < 0.01)


@njit(cache=True, nogil=True)
def fly_cascade(
    x: np.ndarray,
    dt: float,
    every: int,
    forcing: Forcing,
    craft: CraftParameters,
    autopilot: AutopilotState,
    now: Instant,
    records: np.ndarray,
) -> tuple[int, int, int]:
    """Fly a reference with the PID cascade of Elhesasy 2024, x in place; a record (56 + 2 n,) every few steps of dt.

    Physics and inertial sensors run every step, attitude control every second step, position control five times
    slower (every tenth step). Once a motor failed, two seconds on its side disarm the craft, as by ArduPilot's crash
    check. Returns the number of records, how it ended (COMPLETED, DIVERGED or OVERTURNED: tilted by more than 90 deg
    with all motors sound, which no mission asks for) and the last step.
    """
    frame, air, drive, cascade, sensors = craft
    n = now.pwm.size
    steps = forcing.winds.shape[0]
    work, load, C = np.empty((5, x.size)), np.empty(7), np.empty((3, 3))
    rate = np.zeros(3)
    coefficients = low_pass(cascade.filter_frequency, dt)
    limited = False
    state, still, tipped, row, clips = DISARMED, 0, 0, 0, 0
    for k in range(steps):
        tick, wind, excitation = k // 10, forcing.winds[k], forcing.excitation[k // 2]
        rotation_matrix(x[ATTITUDE:RATE], C)
        sound = forcing.speed[tick].min() == 1.0
        if C[2, 2] < 0.0 and sound:
            return row, OVERTURNED, k
        attitude_angles(C, now.angles)
        errors, drift = forcing.navigation[tick], forcing.drift[tick]

        if k % 10 == 0:
            discharge(k * dt, frame)
            if state != LANDED:
                state = forcing.phase[tick]
            # Landed: nearly still for one second while the reference keeps sinking.
            if state == LANDING:
                still = still + 1 if touched_down(x) else 0
                if still * (10.0 * dt) > 1.0:
                    state = LANDED
            tipped = tipped + 1 if C[2, 2] < sqrt(0.5) and not sound else 0
            if tipped * (10.0 * dt) > 2.0:
                state = LANDED
            yaw = now.angles[2] + errors[8]
            if state in (FLYING, LANDING):
                target = forcing.reference[tick]
                level, gravity = forcing.level[tick], frame.gravity
                position_control(
                    x, C[2, 2], yaw, target, errors, level, limited, 10.0 * dt, gravity, cascade, autopilot
                )
            else:
                stand_by(wrap(yaw), autopilot)

        derivative(x, now.command, wind, frame, air, work[0], load)
        for i in range(3):
            now.specific_force[i] = load[i] / frame.mass[0]
        clips += sense_motion(x, forcing.noise[k], drift, sensors, coefficients, k == 0, now)

        if k % 2 == 0:
            autopilot.angle[0] = now.angles[0] + errors[6]
            autopilot.angle[1] = now.angles[1] + errors[7]
            autopilot.angle[2] = wrap(now.angles[2] + errors[8])
            if state in (FLYING, LANDING):
                # The autopilot knows its gyro bias: it flies on the corrected rate.
                for i in range(3):
                    rate[i] = now.measured[i] - sensors.gyro_bias[i] - drift[i]
                attitude_control(rate, limited, 2.0 * dt, cascade, autopilot)
            limited = motor_outputs(state, excitation, drive, cascade.mixer, autopilot, now.pwm)

        draw(load[6], dt, drive, now.pack)
        for i in range(n):
            now.command[i] = forcing.speed[tick, i] * drive_speed(now.pwm[i], now.pack[0], drive)

        if k % every == 0:
            records[row, 0] = k * dt
            record(records[row], x, work[0, VELOCITY:ATTITUDE], wind, excitation, autopilot, now)
            records[row, 53], records[row, 54], records[row, 55] = state, clips, frame.mass[0]
            row += 1

        rk4_step(x, now.command, wind, dt, frame, air, work)
        if not sensible(x):
            return row, DIVERGED, k
    return row, COMPLETED, steps


@inner
def first_order(cutoff: float, dt: float) -> float:
    """Return the step of a first-order low-pass of a cutoff [Hz]; 1 for none."""
    return 1.0 if cutoff <= 0.0 else dt / (dt + 1.0 / (2.0 * pi * cutoff))


@njit(cache=True, nogil=True)
def fly_axis(c: AxisParameters, f: AxisSignals, loop: float) -> tuple[np.ndarray, ...]:
    """Fly one axis: physics at 4.8 kHz, ArduCopter's controllers at 400 Hz (the length of `loop` in s).

    Returns, each of shape (N,), controller output with the chirp and without, its integral and derivative terms, the
    filtered measurement that it was computed from, the mean over the loop before of what the filter got, the rate
    target before and after its filter, attitude and its target.
    """
    n, substeps = f.disturbance.shape
    h = loop / substeps
    output, feedback, measured = np.zeros(n), np.zeros(n), np.zeros(n)
    target, attitude, leans, terms = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((2, n))
    unfiltered, asked = np.zeros(n), np.zeros(n)
    motor = rate = angle = flex = flex_rate = 0.0
    position = velocity = 0.0
    low = first = second = 0.0
    b0, a1, a2 = low_pass(c.filter_hz, h)
    delay_steps = round(c.delay / h)
    pending = np.zeros(delay_steps + 1)
    bend_rate = 2.0 * pi * c.flex_hz
    keep_target, keep_error, keep_slope = (
        first_order(c.FLTT, loop),
        first_order(c.FLTE, loop),
        first_order(c.FLTD, loop),
    )
    gains, memory = np.array([c.P, c.I, c.D]), np.zeros(3)
    filtered = error = 0.0
    decay = exp(-h / c.lag) if c.lag > 0.0 else 0.0
    fall = exp(-c.damping * h)
    for k in range(n):
        y = low + f.noise[k]
        measured[k], attitude[k] = y, angle
        lean = f.stick[k]
        if c.velocity_P > 0.0:
            wanted = c.position_P * (f.position_chirp[k] - position) + f.velocity_chirp[k]
            lean += c.velocity_P * (wanted - velocity) / GRAVITY
            velocity += loop * (GRAVITY * angle - 0.3 * velocity)  # drag over mass, 1/s
            position += loop * velocity
        leans[k] = lean
        want = c.angle_P * (lean - angle) if c.integrates else lean
        want += f.rate_chirp[k]
        # As in the firmware, the rate controller runs before the angle controller and sees its target a loop later.
        filtered += keep_target * ((asked[k - 1] if k else 0.0) - filtered)
        asked[k] = want
        target[k] = filtered
        error += keep_error * (filtered - y - error)
        feedback[k] = pid(error, gains, memory, keep_slope, loop, c.IMAX) + c.FF * filtered
        terms[0, k], terms[1, k] = memory[0], c.D * memory[1]
        u = min(max(feedback[k] + f.mixer_chirp[k], -c.limit), c.limit)
        output[k] = u
        for j in range(substeps):
            for m in range(delay_steps):
                pending[m] = pending[m + 1]
            pending[delay_steps] = u
            command = pending[0]
            before = motor
            motor = command + (motor - command) * decay
            push = c.gain * 0.5 * (before + motor if c.lag > 0.0 else 2.0 * motor) + f.disturbance[k, j]
            if c.integrates:
                rate_before = rate
                rate = rate * fall + push * (1.0 - fall) / c.damping if c.damping > 0.0 else rate + push * h
                angle += 0.5 * h * (rate + rate_before)
                moving = rate
            else:
                moving = push
            if c.flex_hz > 0.0:
                bend = c.flex_share * push - 2.0 * c.flex_damping * bend_rate * flex_rate - bend_rate**2 * flex
                flex_rate += h * bend
                flex += h * flex_rate
                moving += flex_rate
            moving += f.gyro_noise[k, j]
            if k + 1 < n:
                unfiltered[k + 1] += moving / substeps
            if c.filter_hz > 0.0:
                low = b0 * moving + first
                first = 2.0 * b0 * moving - a1 * low + second
                second = b0 * moving - a2 * low
            else:
                low = moving
    return output, feedback, terms[0], terms[1], measured, unfiltered, asked, target, attitude, leans
