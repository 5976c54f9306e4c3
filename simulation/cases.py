"""The flights that rotorid can simulate, and the sample logs made of them."""

import dataclasses
import datetime as dt
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from simulation import elhesasy2024
from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.dataflash_log import write_bin
from simulation.drive import FirstOrder
from simulation.errors import ParameterError
from simulation.fly import Flight, Setup, fly
from simulation.instruments import InstrumentedFlight
from simulation.mission import GoTo, Mission, Turn, Wait
from simulation.place import Place
from simulation.rotor import QuadraticRotor, Rotor
from simulation.sensors import Gps, Inertial, Magnetometer, Sensors
from simulation.telemetry_log import write_tlog
from simulation.wind import Wind


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A flight that can be simulated by name.

    Attributes
    ----------
    name : str
        Also the name of its log.
    summary : str
        What is flown, in a line.
    setup : Setup
        Everything that determines the flight.
    start_utc : datetime
        UTC at the start of the simulation.
    boot : float
        Time since the autopilot's boot at that instant, s.
    imu_rate : float
        IMU rows per second in the log.
    telemetry : bool
        Whether a telemetry log (`.tlog`) is written beside the on-board log.
    """

    name: str
    summary: str
    setup: Setup
    start_utc: dt.datetime
    boot: float = 18.0
    imu_rate: float = 50.0
    telemetry: bool = False


def _octocopter(
    name: str,
    summary: str,
    *,
    mission: Mission,
    place: Place,
    wind: Wind,
    sensors: Sensors,
    seed: int,
    start_utc: dt.datetime,
    boot: float,
    imu_rate: float = 50.0,
    telemetry: bool = False,
) -> Case:
    setup = Setup(
        mission=mission, place=place, vehicle=elhesasy2024.octocopter(), wind=wind, sensors=sensors, seed=seed
    )
    return Case(
        name=name,
        summary=summary,
        setup=setup,
        start_utc=start_utc,
        boot=boot,
        imu_rate=imu_rate,
        telemetry=telemetry,
    )


def _sensors(
    lag: float, gyro_bias: tuple[float, ...], accel_bias: tuple[float, ...], iron: tuple[float, ...]
) -> Sensors:
    """Instruments with the given GPS lag [s], biases [mrad/s, mm/s^2] and hard iron [nT]."""
    return Sensors(
        inertial=Inertial(
            gyro_bias=(gyro_bias[0] * 1e-3, gyro_bias[1] * 1e-3, gyro_bias[2] * 1e-3),
            accel_bias=(accel_bias[0] * 1e-3, accel_bias[1] * 1e-3, accel_bias[2] * 1e-3),
        ),
        gps=Gps(lag=lag),
        magnetometer=Magnetometer(hard_iron=(iron[0] * 1e-9, iron[1] * 1e-9, iron[2] * 1e-9)),
    )


# Elhesasy 2024, section 4.2: points at different places and altitudes, flown at different times and winds; altitude
# changes in place, relocations in 3-D, landing elsewhere, heading held.
_ALL = (
    _octocopter(
        "octa01_zurich_calm",
        "altitude steps in place, one relocation, no wind",
        mission=Mission(
            takeoff=8.0,
            steps=(Wait(2), GoTo(0, 0, 14), Wait(2), GoTo(0, 0, 6), Wait(2), GoTo(14, -8, 11), Wait(3), GoTo(18, 4, 5)),
        ),
        place=Place(name="Zurich", lat_deg=47.3977, lon_deg=8.5456, alt=488.0),
        wind=Wind(),
        sensors=_sensors(0.12, (0.8, -0.5, 0.4), (20, -15, 30), (300, -200, 150)),
        seed=101,
        start_utc=dt.datetime(2025, 3, 12, 9, 15, 0, tzinfo=dt.UTC),
        boot=18.4,
    ),
    _octocopter(
        "octa02_alain_breeze",
        "relocations in 3-D and altitude steps, 2 m/s of wind, warm air",
        mission=Mission(
            takeoff=6.0,
            heading_deg=30.0,
            steps=(
                *(Wait(2), GoTo(0, 0, 12), GoTo(16, 10, 12), Wait(2), GoTo(16, 10, 7)),
                *(Wait(2), GoTo(-4, 14, 10, 4.0), Wait(2), GoTo(-6, 2, 5)),
            ),
        ),
        place=Place(name="Al Ain", lat_deg=24.1990, lon_deg=55.6760, alt=292.0, warmer=8.0),
        wind=Wind(speed=2.0, from_deg=320.0),
        sensors=_sensors(0.15, (-0.6, 0.9, 0.2), (-25, 10, -20), (-250, 180, 220)),
        seed=102,
        start_utc=dt.datetime(2025, 4, 3, 14, 40, 0, tzinfo=dt.UTC),
        boot=22.1,
        telemetry=True,
    ),
    _octocopter(
        "octa03_quito_high",
        "a square in thin air at 2850 m, 1.5 m/s of wind",
        mission=Mission(
            takeoff=7.0,
            heading_deg=-20.0,
            steps=(
                *(Wait(2), GoTo(12, 0, 9), Wait(1.5), GoTo(12, 12, 12), Wait(1.5), GoTo(0, 12, 8)),
                *(Wait(1.5), GoTo(0, 0, 11), Wait(2), GoTo(4, -6, 5)),
            ),
        ),
        place=Place(name="Quito", lat_deg=-0.2100, lon_deg=-78.4900, alt=2850.0, warmer=4.0),
        wind=Wind(speed=1.5, from_deg=110.0),
        sensors=_sensors(0.12, (0.3, 0.6, -0.7), (15, 25, 10), (200, 260, -180)),
        seed=103,
        start_utc=dt.datetime(2025, 5, 20, 16, 5, 0, tzinfo=dt.UTC),
        boot=30.0,
    ),
    _octocopter(
        "octa04_bergen_gusty",
        "relocations at sea level in 3 m/s of gusty wind, cold air, IMU rows at 25 Hz",
        mission=Mission(
            takeoff=9.0,
            heading_deg=75.0,
            steps=(
                *(Wait(3), GoTo(-12, 8, 9), Wait(2), GoTo(-12, 8, 15), Wait(2)),
                *(GoTo(6, -8, 12, 4.0), Wait(3), GoTo(2, -2, 6), Wait(1)),
            ),
        ),
        place=Place(name="Bergen", lat_deg=60.3913, lon_deg=5.3221, alt=12.0, warmer=-6.0),
        wind=Wind(speed=3.0, from_deg=225.0, gusts=1.3),
        sensors=_sensors(0.20, (-0.9, -0.4, 0.5), (-10, -30, 25), (-180, -280, 200)),
        seed=104,
        start_utc=dt.datetime(2025, 2, 18, 11, 30, 0, tzinfo=dt.UTC),
        boot=25.6,
        imu_rate=25.0,
    ),
    _octocopter(
        "octa05_nairobi_turns",
        "altitude steps, turns on the spot and relocations at 1660 m, 2.5 m/s of wind",
        mission=Mission(
            takeoff=6.0,
            heading_deg=120.0,
            steps=(
                *(Wait(2), GoTo(0, 0, 10), Turn(180.0), GoTo(-10, 6, 13), Wait(2), GoTo(-10, 6, 8)),
                *(Turn(90.0), Wait(1.5), GoTo(4, 14, 11), Wait(2), GoTo(10, 10, 5)),
            ),
        ),
        place=Place(name="Nairobi", lat_deg=-1.2921, lon_deg=36.8219, alt=1660.0, warmer=6.0),
        wind=Wind(speed=2.5, from_deg=60.0),
        sensors=_sensors(0.16, (0.5, -0.8, -0.3), (30, 5, -25), (150, 240, 260)),
        seed=105,
        start_utc=dt.datetime(2025, 6, 9, 7, 50, 0, tzinfo=dt.UTC),
        boot=41.2,
    ),
)

#: Every case by name.
CASES: Mapping[str, Case] = MappingProxyType({case.name: case for case in _ALL})


def find(name: str) -> Case:
    """Give the case of this name.

    Raises
    ------
    ParameterError
        There is no such case; the message lists those that there are.
    """
    if name not in CASES:
        raise ParameterError(f"no case called {name!r}; there are: {', '.join(CASES)}")
    return CASES[name]


def write_case(case: Case, folder: str | Path) -> list[Path]:
    """Fly a case and write its log (`.bin`), its truth (`.json`) and, where it has one, its telemetry log (`.tlog`).

    Parameters
    ----------
    case : Case
    folder : path-like
        Made if missing.

    Returns
    -------
    list of Path
        The files written, the on-board log first.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    flight = fly(case.setup)
    log = InstrumentedFlight(flight, case.start_utc, case.boot)
    paths = [folder / f"{case.name}.bin", folder / f"{case.name}.json"]
    write_bin(paths[0], log, case.imu_rate)
    paths[1].write_text(json.dumps(describe_truth(case, flight), indent=1) + "\n", encoding="utf-8")
    if case.telemetry:
        paths.append(folder / f"{case.name}.tlog")
        write_tlog(paths[2], log)
    return paths


def write_sample_logs(folder: str | Path, progress: Callable[[str, float], None] | None = None) -> list[Path]:
    """Fly all cases and write the sample logs with their truth; the same files on every run.

    Parameters
    ----------
    folder : path-like
        Made if missing; files of the same names are overwritten.
    progress : callable, optional
        Called with what is being written and the fraction done.

    Returns
    -------
    list of Path
        The files written.
    """
    paths: list[Path] = []
    for done, case in enumerate(CASES.values()):
        if progress is not None:
            progress(case.name, done / len(CASES))
        paths += write_case(case, folder)
    if progress is not None:
        progress("sample logs", 1.0)
    return paths


def describe_truth(case: Case, flight: Flight) -> dict[str, object]:
    """Say in numbers what an identification of the flight should find; keys carry their units."""
    setup = case.setup
    vehicle, place, wind, sensors = setup.vehicle, setup.place, setup.wind, setup.sensors
    drive, rotor, battery = vehicle.drive, vehicle.rotors[0].rotor, vehicle.battery
    air = place.atmosphere
    flying = flight.truth.loc[flight.airborne[0] : flight.airborne[1]]
    density = [air.density_at(-p_d) for p_d in flying["p_d"]]
    return {
        "name": case.name,
        "what": f"simulated by rotorid, not flown: {case.summary}",
        "seed": setup.seed,
        "start_utc": case.start_utc.isoformat(),
        "time_s": {
            "note": "on the log's boot clock (TimeUS / 1e6)",
            "log_start": case.boot,
            "arm": round(case.boot + flight.reference.arm, 4),
            "airborne": [round(case.boot + t, 2) for t in flight.airborne],
            "disarm": round(case.boot + flight.disarm, 2),
        },
        "place": {
            "name": place.name,
            "lat_deg": place.lat_deg,
            "lon_deg": place.lon_deg,
            "alt_amsl_m": place.alt,
            "gravity_m_s2": round(place.gravity, 5),
            "air_temperature_ground_k": round(air.temperature, 2),
            "air_pressure_ground_pa": round(air.pressure, 1),
            "air_density_ground_kg_m3": round(air.density_at(0.0), 5),
            "air_density_airborne_mean_kg_m3": round(math.fsum(density) / len(density), 5),
        },
        "wind": {
            "speed_m_s": wind.speed,
            "from_deg": wind.from_deg,
            "mean_ned_m_s": [round(float(v), 4) for v in wind.mean],
            "gusts": "Dryden, MIL-F-8785C low altitude, passing with the mean wind" if wind.speed else "none",
            "gust_sigma_m_s": [round(float(v), 4) for v in wind.scales()[0]],
            "airborne_mean_ned_m_s": [round(float(flying[f"wind_{axis}"].mean()), 4) for axis in "ned"],
        },
        "vehicle": {
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
                    "layer": "upper" if mount.layer > 0 else "lower",
                }
                for k, mount in enumerate(vehicle.rotors, start=1)
            ],
            **_rotor_truth(rotor),
            "speed_max_rad_s": drive.speed_max,
            "time_constant_s": drive.response.time_constant if isinstance(drive.response, FirstOrder) else None,
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
                "voltage_airborne_mean_v": round(float(flying["voltage"].mean()), 3),
            },
        },
        "model": {
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
        },
        "sensors": {
            "imu_filter_hz": setup.cascade.filter_frequency,
            "imu_rate_hz": case.imu_rate,
            "gyro_bias_rad_s": list(sensors.inertial.gyro_bias),
            "accel_bias_m_s2": list(sensors.inertial.accel_bias),
            "gps_lag_s": sensors.gps.lag,
            "gps_wander_m": [sensors.gps.horizontal_wander, sensors.gps.vertical_wander],
            "gps_wander_time_s": sensors.gps.wander_time,
            "hard_iron_t": list(sensors.magnetometer.hard_iron),
            "magnetic_field_ned_t": [round(float(v), 9) for v in place.magnetic_field(case.start_utc)],
        },
    }


def _rotor_truth(rotor: Rotor) -> dict[str, object]:
    if isinstance(rotor, QuadraticRotor):
        return {
            "thrust_coefficient_n_s2": rotor.thrust_coefficient,
            "torque_coefficient_n_m_s2": rotor.torque_coefficient,
            "reference_density_kg_m3": rotor.reference_density,
        }
    return {"blade_element": dataclasses.asdict(rotor), "reference_density_kg_m3": SEA_LEVEL_DENSITY}
