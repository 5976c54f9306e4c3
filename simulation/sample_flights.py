"""The flights behind `sample_logs/`: the octocopter of Elhesasy 2024 on missions as in the paper, and a quadcopter."""

import dataclasses
import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from simulation import elhesasy2024, survey_quadcopter
from simulation.flight_log import Logging
from simulation.fly import Setup
from simulation.mission import Chirp, GoTo, Mission, Turn, Wait
from simulation.place import Place
from simulation.sensors import Gps, Inertial, Magnetometer, Sensors
from simulation.wind import Wind

_USUAL = Logging()


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleFlight:
    """A mission that can be flown by name."""

    name: str  #: Also the name of its log.
    summary: str  #: What is flown, in a line.
    setup: Setup  #: Everything that determines the flight.
    start_utc: dt.datetime  #: UTC at the start of the simulation.
    boot: float = 18.0  #: Time since the autopilot's boot at that instant, s.
    logging: Logging = _USUAL  #: What is logged how often.
    telemetry: bool = False  #: Whether a telemetry log (`.tlog`) is written beside the on-board log.


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
    logging: Logging = _USUAL,
    telemetry: bool = False,
) -> SampleFlight:
    setup = Setup(
        mission=mission, place=place, vehicle=elhesasy2024.octocopter(), wind=wind, sensors=sensors, seed=seed
    )
    return SampleFlight(
        name=name,
        summary=summary,
        setup=setup,
        start_utc=start_utc,
        boot=boot,
        logging=logging,
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


def _drifting(
    lag: float,
    gyro_bias: tuple[float, ...],
    accel_bias: tuple[float, ...],
    iron: tuple[float, ...],
    outages: tuple[tuple[float, float], ...] = (),
) -> Sensors:
    """Instruments as above whose biases drift (0.01 deg/s and 2 mg), as consumer grade ones do."""
    sensors = _sensors(lag, gyro_bias, accel_bias, iron)
    return dataclasses.replace(
        sensors,
        inertial=dataclasses.replace(sensors.inertial, gyro_instability=1.7e-4, accel_instability=0.02),
        gps=dataclasses.replace(sensors.gps, outages=outages),
    )


# Elhesasy 2024, section 4.2: points at different places and altitudes, flown at different times and winds; altitude
# changes in place, relocations in 3-D, landing elsewhere, heading held.

#: Three flights to fit models to.
TRAINING = (
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
)

#: Nine others, to judge by.
VALIDATION = (
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
        logging=Logging(imu=25.0),
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
    _octocopter(
        "octa06_reykjavik_windy",
        "relocations in 3-D at sea level in 5 m/s of wind; the biases drift",
        mission=Mission(
            takeoff=7.0,
            heading_deg=200.0,
            steps=(
                *(Wait(2), GoTo(10, 6, 10), Wait(2), GoTo(10, 6, 16), Wait(2)),
                *(GoTo(-6, 12, 9, 4.0), Wait(2), GoTo(-4, -4, 6)),
            ),
        ),
        place=Place(name="Reykjavik", lat_deg=64.1300, lon_deg=-21.9400, alt=15.0, warmer=-8.0),
        wind=Wind(speed=5.0, from_deg=150.0),
        sensors=_drifting(0.14, (0.7, 0.3, -0.6), (-20, 25, 15), (220, -140, 240)),
        seed=106,
        start_utc=dt.datetime(2025, 7, 2, 18, 20, 0, tzinfo=dt.UTC),
        boot=19.7,
    ),
    _octocopter(
        "octa07_singapore_hot",
        "altitude steps in place, then two relocations, hot humid air, 1 m/s of wind",
        mission=Mission(
            takeoff=5.0,
            heading_deg=-90.0,
            steps=(
                *(Wait(2), GoTo(0, 0, 9), Wait(2), GoTo(0, 0, 13), Wait(2), GoTo(0, 0, 8), Wait(2)),
                *(GoTo(-12, -10, 12), Wait(2), GoTo(-18, -2, 6)),
            ),
        ),
        place=Place(name="Singapore", lat_deg=1.3000, lon_deg=103.8000, alt=10.0, warmer=16.0),
        wind=Wind(speed=1.0, from_deg=20.0),
        sensors=_drifting(0.18, (-0.4, -0.7, 0.6), (10, -20, -30), (-120, 300, 160)),
        seed=107,
        start_utc=dt.datetime(2025, 8, 14, 3, 45, 0, tzinfo=dt.UTC),
        boot=27.3,
    ),
    _octocopter(
        "octa08_denver_square",
        "a square at 1600 m in 2 m/s of gusty wind",
        mission=Mission(
            takeoff=8.0,
            heading_deg=45.0,
            steps=(
                *(Wait(2), GoTo(0, 14, 8), Wait(1), GoTo(-14, 14, 10), Wait(1), GoTo(-14, 0, 12), Wait(1)),
                *(GoTo(0, 0, 9), Wait(2), GoTo(6, 4, 5)),
            ),
        ),
        place=Place(name="Denver", lat_deg=39.7400, lon_deg=-104.9900, alt=1609.0, warmer=10.0),
        wind=Wind(speed=2.0, from_deg=270.0, gusts=1.5),
        sensors=_drifting(0.12, (0.2, 0.8, 0.3), (-15, 15, 20), (260, 120, -220)),
        seed=108,
        start_utc=dt.datetime(2025, 9, 5, 20, 10, 0, tzinfo=dt.UTC),
        boot=33.8,
    ),
    _octocopter(
        "octa09_capetown_outage",
        "relocations in 3 m/s of wind; the GPS receiver loses its fix for six seconds",
        mission=Mission(
            takeoff=6.0,
            heading_deg=160.0,
            steps=(
                *(Wait(2), GoTo(8, -12, 11), Wait(2), GoTo(8, -12, 7), Wait(3)),
                *(GoTo(-8, -2, 12), Wait(2), GoTo(-2, 6, 5)),
            ),
        ),
        place=Place(name="Cape Town", lat_deg=-33.9200, lon_deg=18.4200, alt=40.0, warmer=3.0),
        wind=Wind(speed=3.0, from_deg=130.0),
        sensors=_drifting(0.15, (-0.8, 0.5, -0.4), (25, -5, -15), (180, 200, -260), outages=((38.0, 44.0),)),
        seed=109,
        start_utc=dt.datetime(2025, 10, 11, 8, 30, 0, tzinfo=dt.UTC),
        boot=21.5,
    ),
    _octocopter(
        "octa10_lhasa_thin",
        "altitude steps and a relocation at 3650 m, the thinnest air of all, 1 m/s of wind",
        mission=Mission(
            takeoff=5.0,
            heading_deg=10.0,
            steps=(
                *(Wait(2), GoTo(0, 0, 10), Wait(3), GoTo(0, 0, 6), Wait(2)),
                *(GoTo(10, 10, 9), Wait(2), GoTo(12, 2, 12), Wait(2), GoTo(14, 0, 5)),
            ),
        ),
        place=Place(name="Lhasa", lat_deg=29.6500, lon_deg=91.1000, alt=3650.0, warmer=8.0),
        wind=Wind(speed=1.0, from_deg=300.0),
        sensors=_drifting(0.13, (0.6, -0.2, 0.7), (-30, -10, 5), (-240, -160, 140)),
        seed=110,
        start_utc=dt.datetime(2025, 6, 24, 5, 0, 0, tzinfo=dt.UTC),
        boot=36.1,
    ),
    _octocopter(
        "octa11_sydney_fast",
        "long relocations at up to 6 m/s in 2 m/s of wind",
        mission=Mission(
            takeoff=8.0,
            heading_deg=-60.0,
            acceleration=1.8,
            steps=(
                *(Wait(2), GoTo(28, 0, 12, 6.0), Wait(2), GoTo(28, 24, 8, 6.0), Wait(2)),
                *(GoTo(2, 20, 14, 6.0), Wait(2), GoTo(0, 4, 6, 4.0)),
            ),
        ),
        place=Place(name="Sydney", lat_deg=-33.8700, lon_deg=151.2100, alt=30.0, warmer=5.0),
        wind=Wind(speed=2.0, from_deg=45.0),
        sensors=_drifting(0.17, (-0.3, -0.9, -0.5), (15, 30, -10), (140, -240, 200)),
        seed=111,
        start_utc=dt.datetime(2025, 11, 19, 1, 25, 0, tzinfo=dt.UTC),
        boot=24.9,
    ),
    _octocopter(
        "octa12_innsbruck_foehn",
        "altitude steps, a turn and relocations in 4 m/s of gusty wind at 580 m",
        mission=Mission(
            takeoff=7.0,
            heading_deg=90.0,
            steps=(
                *(Wait(2), GoTo(0, 0, 12), Wait(2), GoTo(0, 0, 8), Turn(-30.0), Wait(1)),
                *(GoTo(-10, -12, 10), Wait(2), GoTo(4, -10, 14), Wait(2), GoTo(6, 0, 5)),
            ),
        ),
        place=Place(name="Innsbruck", lat_deg=47.2700, lon_deg=11.3900, alt=580.0, warmer=12.0),
        wind=Wind(speed=4.0, from_deg=190.0, gusts=1.4),
        sensors=_drifting(0.16, (0.9, 0.1, 0.4), (5, -25, 25), (-160, 260, -180)),
        seed=112,
        start_utc=dt.datetime(2025, 12, 3, 13, 55, 0, tzinfo=dt.UTC),
        boot=29.4,
    ),
)

#: One craft of another kind, with what the octocopter's logs do not hold.
QUADCOPTERS = (
    SampleFlight(
        name="quad01_davos_esc",
        summary="a quadcopter whose speed controllers report the motors' speeds, at 1560 m in 2 m/s of wind",
        setup=Setup(
            mission=Mission(
                takeoff=6.0,
                heading_deg=20.0,
                steps=(
                    *(Wait(2), GoTo(0, 0, 11), Wait(2), GoTo(12, 6, 9, 4.0), Wait(2), GoTo(12, 6, 14), Turn(-60.0)),
                    *(GoTo(-4, 8, 8, 4.0), Wait(2), GoTo(0, 2, 5)),
                ),
            ),
            place=Place(name="Davos", lat_deg=46.8000, lon_deg=9.8400, alt=1560.0, warmer=-3.0),
            vehicle=survey_quadcopter.quadcopter(),
            wind=Wind(speed=2.0, from_deg=240.0),
            cascade=survey_quadcopter.CASCADE,
            sensors=_drifting(0.12, (0.5, -0.6, 0.3), (-10, 20, 15), (240, 160, -120)),
            seed=201,
        ),
        start_utc=dt.datetime(2025, 8, 30, 9, 40, 0, tzinfo=dt.UTC),
        boot=20.2,
        logging=Logging(esc=25.0, rate=50.0),
    ),
    SampleFlight(
        name="quad02_delft_systemid",
        summary="the quadcopter hovers while chirps are added at the mixer; every step of the rate loop is logged",
        setup=Setup(
            mission=Mission(
                takeoff=15.0,
                heading_deg=0.0,
                steps=tuple(
                    step
                    for axis, magnitude in (("roll", 0.07), ("pitch", 0.07), ("yaw", 0.15), ("throttle", 0.06))
                    for step in (Wait(2), Chirp(axis, magnitude, start_hz=0.5, stop_hz=14.0, seconds=14.0))
                ),
            ),
            place=Place(name="Delft", lat_deg=52.0000, lon_deg=4.3600, alt=2.0, warmer=2.0),
            vehicle=survey_quadcopter.quadcopter(),
            wind=Wind(speed=1.0, from_deg=280.0),
            cascade=survey_quadcopter.CASCADE,
            sensors=_drifting(0.12, (-0.3, 0.4, 0.8), (20, -10, -20), (-140, 220, 180)),
            seed=202,
        ),
        start_utc=dt.datetime(2025, 9, 18, 12, 15, 0, tzinfo=dt.UTC),
        boot=23.6,
        logging=Logging(imu=100.0, rate=400.0),
    ),
)

#: Every flight by name.
FLIGHTS: Mapping[str, SampleFlight] = MappingProxyType(
    {flight.name: flight for flight in (*TRAINING, *VALIDATION, *QUADCOPTERS)}
)
