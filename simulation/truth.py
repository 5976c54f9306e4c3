"""Ground truth of a simulated flight, for comparison with identified values."""

import dataclasses
import math

from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.drive import FirstOrder, QuadraticRotor, Rotor
from simulation.fly import SimulatedFlight
from simulation.instruments import Instruments
from simulation.place import Place
from simulation.vehicle import Multirotor

#: Equations of the simulation, in the keys of the truth.
_MODEL = {
    "command": "a = clip((pwm - pwm_at_zero_thrust) / (pwm_at_full_thrust - pwm_at_zero_thrust), 0, 1)",
    "rotor_speed": "dw/dt = (w_ref - w) / time_constant, "
    "w_ref = speed_max * (V / voltage_reference) * sqrt((1 - expo) * a + expo * a^2)",
    "thrust": "T = thrust_coefficient * (rho / reference_density) * w^2 along -z of the body",
    "torque": "Q = torque_coefficient * (rho / reference_density) * w^2; a clockwise rotor turns the body "
    "counter-clockwise",
    "drag": "F_i = -(drag_linear_i * rho / reference_density + 0.5 * rho * drag_area_i * |v|) * v_i, "
    "v air-relative velocity in body axes",
    "air": "density from air_temperature_ground, air_pressure_ground and 6.5 K/km above the ground",
    "position": "SIM2 and SIM hold the true position, velocity and attitude; the origin is where the centre "
    "of gravity rests before take-off",
    "estimates": "ATT, PSCN, PSCE, PSCD and CTUN hold truth plus a slowly wandering error, on which the "
    "autopilot flew; no estimator was run on board",
}


def describe_mission(
    flight: SimulatedFlight, log: Instruments, name: str, summary: str, imu_rate: float
) -> dict[str, object]:
    """Return the true values of a mission; keys end in their units."""
    setup = flight.setup
    wind, air = setup.wind, setup.place.atmosphere
    flying = flight.truth.loc[flight.airborne[0] : flight.airborne[1]]
    density = [air.density_at(-p_d) for p_d in flying["p_d"]]
    truth: dict[str, object] = {
        "name": name,
        "what": f"simulated by rotorid, not flown: {summary}",
        "seed": setup.seed,
        "start_utc": log.start_utc.isoformat(),
        "time_s": {
            "note": "on the log's boot clock (TimeUS / 1e6)",
            "log_start": log.boot,
            "arm": round(log.boot + flight.reference.arm, 4),
            "airborne": [round(log.boot + t, 2) for t in flight.airborne],
            "disarm": round(log.boot + flight.disarm, 2),
        },
        "place": describe_place(setup.place)
        | {"air_density_airborne_mean_kg_m3": round(math.fsum(density) / len(density), 5)},
        "wind": {
            "speed_m_s": wind.speed,
            "from_deg": wind.from_deg,
            "mean_ned_m_s": [round(float(v), 4) for v in wind.mean],
            "gusts": "Dryden, MIL-F-8785C low altitude, passing with the mean wind" if wind.speed else "none",
            "gust_sigma_m_s": [round(float(v), 4) for v in wind.scales()[0]],
            "airborne_mean_ned_m_s": [round(float(flying[f"wind_{axis}"].mean()), 4) for axis in "ned"],
        },
        "vehicle": describe_vehicle(setup.vehicle, float(flying["voltage"].mean())),
        "model": _MODEL,
        "sensors": describe_sensors(log, imu_rate),
    }
    if setup.losses:
        truth["motor_losses"] = [
            {"motor": loss.motor, "t_s": round(log.boot + loss.t, 4), "thrust_left": loss.thrust}
            for loss in setup.losses
        ]
    if flight.reference.chirps:
        truth["chirps"] = [
            {
                "axis": f"mixer {chirp.axis}",
                "start_s": round(log.boot + start, 4),
                "duration_s": round(chirp.duration, 4),
                "magnitude": chirp.magnitude,
                "from_hz": chirp.start_hz,
                "to_hz": chirp.stop_hz,
            }
            for start, chirp in flight.reference.chirps
        ]
    return truth


def describe_place(place: Place) -> dict[str, object]:
    """Return the place of the flight, its gravity and the air on the ground."""
    air = place.atmosphere
    return {
        "name": place.name,
        "lat_deg": place.lat_deg,
        "lon_deg": place.lon_deg,
        "alt_amsl_m": place.alt,
        "gravity_m_s2": round(place.gravity, 5),
        "air_temperature_ground_k": round(air.temperature, 2),
        "air_pressure_ground_pa": round(air.pressure, 1),
        "air_density_ground_kg_m3": round(air.density_at(0.0), 5),
    }


def describe_sensors(log: Instruments, imu_rate: float) -> dict[str, object]:
    """Return the errors of the instruments."""
    sensors = log.sensors
    inertial = sensors.inertial
    return {
        "imu_filter_hz": log.filter_frequency,
        "imu_rate_hz": imu_rate,
        "gyro_bias_rad_s": list(inertial.gyro_bias),
        "accel_bias_m_s2": list(inertial.accel_bias),
        "gyro_instability_rad_s": inertial.gyro_instability,
        "accel_instability_m_s2": inertial.accel_instability,
        "gps_lag_s": sensors.gps.lag,
        "gps_wander_m": [sensors.gps.horizontal_wander, sensors.gps.vertical_wander],
        "gps_wander_time_s": sensors.gps.wander_time,
        "gps_outages_s": [[round(log.boot + t, 3) for t in outage] for outage in sensors.gps.outages],
        "hard_iron_t": list(sensors.magnetometer.hard_iron),
        "magnetic_field_ned_t": [round(float(v), 9) for v in log.place.magnetic_field(log.start_utc)],
    }


def describe_vehicle(vehicle: Multirotor, voltage: float) -> dict[str, object]:
    """Return the parameters of the craft, with the mean voltage of its battery in flight."""
    drive, rotor, battery = vehicle.drive, vehicle.rotors[0].rotor, vehicle.battery
    truth: dict[str, object] = {
        "name": vehicle.name,
        "mass_kg": vehicle.mass,
        "inertia_kg_m2": vehicle.inertia.tolist(),
        "frame": vehicle.frame,
        "motors": [
            {
                "motor": k,
                "servo_output": f"RCOU.C{k}",
                "position_frd_m": [round(v, 6) for v in mount.position],
                "spin": "clockwise" if mount.spin > 0 else "counter-clockwise",
                "layer": {1: "upper", -1: "lower", 0: "only"}[mount.layer],
                "inertia_kg_m2": mount.inertia,
            }
            for k, mount in enumerate(vehicle.rotors, start=1)
        ],
        **_rotor_truth(rotor),
        "reference_density_kg_m3": SEA_LEVEL_DENSITY,
        "speed_max_rad_s": drive.speed_max,
        **_response_truth(vehicle),
        "expo": drive.expo,
        "voltage_reference_v": drive.voltage_reference,
        "pwm_at_zero_thrust_us": drive.pwm_at_zero_thrust,
        "pwm_at_full_thrust_us": drive.pwm_at_full_thrust,
        "thrust_max_per_motor_n": round(rotor.thrust(drive.speed_max), 5),
        "drag_linear_n_s_m": list(vehicle.drag_linear),
        "drag_area_m2": list(vehicle.drag_area),
        "battery": {
            "voltage_full_v": battery.voltage_full,
            "voltage_empty_v": battery.voltage_empty,
            "capacity_ah": battery.capacity,
            "resistance_ohm": battery.resistance,
            "voltage_airborne_mean_v": round(voltage, 3),
        },
    }
    if vehicle.tank is not None:
        truth["tank"] = {
            "time_s": list(vehicle.tank.time),
            "mass_kg": list(vehicle.tank.mass),
            "inertia_kg_m2": [inertia.tolist() for inertia in vehicle.tank.inertia],
        }
    return truth


def _rotor_truth(rotor: Rotor) -> dict[str, object]:
    if isinstance(rotor, QuadraticRotor):
        return {
            "thrust_coefficient_n_s2": rotor.thrust_coefficient,
            "torque_coefficient_n_m_s2": rotor.torque_coefficient,
        }
    return {"blade_element": dataclasses.asdict(rotor)}


def _response_truth(vehicle: Multirotor) -> dict[str, object]:
    response = vehicle.drive.response
    if isinstance(response, FirstOrder):
        return {"time_constant_s": response.time_constant}
    return {"third_order_drive": dataclasses.asdict(response)}
