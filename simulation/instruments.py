"""A simulated flight as its instruments and its autopilot measure it, before it is written as a log."""

import datetime as dt
import math

import numpy as np
import numpy.typing as npt
import pandas as pd
import pymap3d
from scipy.spatial.transform import Rotation

from simulation.atmosphere import LAPSE_RATE, PRESSURE_EXPONENT, SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE
from simulation.fly import SimulatedFlight
from simulation.place import Place
from simulation.sensors import Sensors
from simulation.vehicle import Multirotor

#: Parameters in the order of the log; those of the craft replace the zeros.
_PARAMETERS = """
FORMAT_VERSION=120 FRAME_CLASS=0 FRAME_TYPE=0 MOT_PWM_TYPE=0 MOT_PWM_MIN=0 MOT_PWM_MAX=0 MOT_SPIN_ARM=0 MOT_SPIN_MIN=0
MOT_SPIN_MAX=0 MOT_THST_EXPO=0 MOT_BAT_VOLT_MAX=0 MOT_BAT_VOLT_MIN=0 INS_GYRO_FILTER=0 INS_ACCEL_FILTER=0 GPS1_TYPE=1
GPS1_RATE_MS=0 GPS1_DELAY_MS=0 GPS1_POS_X=0 GPS1_POS_Y=0 GPS1_POS_Z=0 COMPASS_ENABLE=1 COMPASS_USE=1 COMPASS_AUTODEC=1
COMPASS_ORIENT=0 COMPASS_OFS_X=0 COMPASS_OFS_Y=0 COMPASS_OFS_Z=0 AHRS_ORIENTATION=0 AHRS_TRIM_X=0 AHRS_TRIM_Y=0
BATT_MONITOR=4 BATT_CAPACITY=0 BARO1_GND_PRESS=0 SCHED_LOOP_RATE=400 LOG_DISARMED=1
"""

#: Filters of the rate loops [Hz], 0 for none, and the limit of their integral.
RATE_FILTERS = {"IMAX": 1.0, "FF": 0.0, "FLTT": 0.0, "FLTE": 0.0, "FLTD": 20.0}

_GPS_EPOCH = dt.datetime(1980, 1, 6, tzinfo=dt.UTC)

Column = npt.NDArray[np.float64]


def attitude_angles(rows: pd.DataFrame) -> tuple[Column, Column, Column]:
    """Return roll, pitch and yaw [rad] of the quaternions q_w, q_x, q_y, q_z of rows."""
    q = rows[["q_w", "q_x", "q_y", "q_z"]].to_numpy(dtype=float, copy=True)
    yaw, pitch, roll = Rotation.from_quat(q, scalar_first=True).as_euler("ZYX").T
    return roll, pitch, yaw


class Instruments:
    """A simulated craft with the samples of its instruments.

    `truth` has the index `t` [s] and as columns those of `simulation.fly.RECORD_COLUMNS` that are known, w1 ... and m1
    ...; `start_utc` and `boot` [s since boot] are the start of the simulation, `imu_rate` [Hz] the samples before the
    low-pass of `filter_frequency` [Hz].
    """

    def __init__(
        self,
        truth: pd.DataFrame,
        vehicle: Multirotor,
        place: Place,
        sensors: Sensors,
        *,
        seed: int,
        start_utc: dt.datetime,
        boot: float,
        filter_frequency: float,
        imu_rate: float,
    ):
        self.truth, self.vehicle, self.place, self.sensors = truth, vehicle, place, sensors
        self.seed, self.start_utc, self.boot = seed, start_utc, boot
        self.filter_frequency, self.imu_rate = filter_frequency, imu_rate
        # A random stream for each instrument: changing one leaves the others as they are.
        streams = [np.random.RandomState(seed * 10 + k) for k in range(1, 5)]
        self.gps = sensors.gps.sample(truth, place, streams[0])
        self.baro = sensors.barometer.sample(truth, place, streams[1])
        field_n = np.round(place.magnetic_field(start_utc), 9)
        self.mag = sensors.magnetometer.sample(truth, field_n, streams[2])
        self.battery = self.rows(10.0)[["voltage", "current", "charge"]].copy()
        self.battery["voltage"] += 0.015 * streams[3].standard_normal(len(self.battery))
        self.battery["current"] += 0.2 * streams[3].standard_normal(len(self.battery))

    def rows(self, rate: float) -> pd.DataFrame:
        """Return the records of the flight at `rate` [Hz]."""
        truth = self.truth
        step = round(1.0 / rate / (truth.index[1] - truth.index[0]))
        return truth.iloc[::step]

    def geodetic(self, rows: pd.DataFrame) -> tuple[Column, Column, Column]:
        """Return latitude [deg], longitude [deg] and altitude [m] of the positions p_n, p_e, p_d in `rows`."""
        north, east, down = (rows[name].to_numpy() for name in ("p_n", "p_e", "p_d"))
        lat, lon, alt = pymap3d.ned2geodetic(north, east, down, self.place.lat_deg, self.place.lon_deg, self.place.alt)
        return lat, lon, alt

    def messages(self) -> list[tuple[float, str]]:
        """Return the texts of the autopilot with their times on the simulation's clock."""
        return [
            (0.0, "ArduCopter V4.7.0-sim (simulated by rotorid)"),
            (0.0, f"simulated, not flown: {self.place.name}, seed {self.seed}"),
            (0.0, f"Frame: {self.vehicle.frame}"),
        ]

    def parameters(self) -> dict[str, float]:
        """Return the parameters of the autopilot that describe this craft, by ArduPilot's names."""
        vehicle, drive, sensors = self.vehicle, self.vehicle.drive, self.sensors
        parameters = {name: float(value) for name, value in (line.split("=") for line in _PARAMETERS.split())}
        motors = ("PWM_MIN", "PWM_MAX", "SPIN_ARM", "SPIN_MIN", "SPIN_MAX")
        parameters |= {f"MOT_{name}": getattr(drive, name.lower()) for name in motors}
        parameters |= {
            "FRAME_CLASS": vehicle.frame_class,
            "FRAME_TYPE": vehicle.frame_type,
            "MOT_THST_EXPO": drive.expo,
            "INS_GYRO_FILTER": self.filter_frequency,
            "INS_ACCEL_FILTER": self.filter_frequency,
            "GPS1_RATE_MS": round(1000.0 / sensors.gps.rate),
            "GPS1_DELAY_MS": round(1000.0 * sensors.gps.lag),
            "BATT_CAPACITY": round(1000.0 * vehicle.battery.capacity),
            "BARO1_GND_PRESS": round(float(self.baro["pressure"].iloc[0]), 1),
        }
        for number in range(1, 17):
            parameters[f"SERVO{number}_FUNCTION"] = 32 + number if number <= len(vehicle.rotors) else 0
        return parameters

    def gps_time(self, t: Column) -> tuple[Column, npt.NDArray[np.int64]]:
        """Return the second of the GPS week and the GPS week at times on the simulation's clock."""
        offset = (self.start_utc - _GPS_EPOCH).total_seconds() + 18.0  # leap seconds
        week = ((offset + t) // 604800.0).astype(np.int64)
        return offset + t - 604800.0 * week, week

    def pressure_altitude(self) -> Column:
        """Return the height by the barometer above where it was calibrated, m."""
        pressure = self.baro["pressure"].to_numpy()
        ratio = np.array([math.pow(p / SEA_LEVEL_PRESSURE, 1.0 / PRESSURE_EXPONENT) for p in pressure])
        altitude: Column = SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - ratio)
        altitude -= altitude[:10].mean()
        return altitude


class InstrumentedFlight(Instruments):
    """A mission flown under the cascade, with the samples of its instruments."""

    def __init__(self, flight: SimulatedFlight, start_utc: dt.datetime, boot: float):
        setup = flight.setup
        super().__init__(
            flight.truth,
            setup.vehicle,
            setup.place,
            setup.sensors,
            seed=setup.seed,
            start_utc=start_utc,
            boot=boot,
            filter_frequency=setup.cascade.filter_frequency,
            imu_rate=1.0 / setup.step,
        )
        self.flight = flight

    def navigated(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return position and velocity as the autopilot estimates them, at the times of `rows`."""
        reference, errors = self.planned(rows), self.flight.navigation
        columns = ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]
        ticks = reference["tick"].to_numpy()
        return pd.DataFrame(rows[columns].to_numpy() + errors[ticks, 0:6], index=rows.index, columns=columns)

    def planned(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return position, velocity and acceleration of the mission at the times of `rows`; `tick` is its row."""
        tick = self.flight.reference.tick_at(rows.index.to_numpy())
        columns = ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "a_n", "a_e", "a_d", "yaw"]
        planned = pd.DataFrame(self.flight.reference.samples[tick], index=rows.index, columns=columns)
        planned["tick"] = tick
        return planned

    def messages(self) -> list[tuple[float, str]]:
        """Return the texts of the autopilot with their times on the simulation's clock."""
        flight = self.flight
        texts = [
            *super().messages(),
            (flight.reference.arm, "Arming motors"),
            (flight.reference.takeoff, "Mission: 1 Takeoff"),
        ]
        items = (*flight.reference.items, (flight.reference.land, "Land"))
        texts += [(t, f"Mission: {k} {name}") for k, (t, name) in enumerate(items, start=2) if t < flight.disarm]
        texts.append((flight.disarm, "Crash: Disarming" if flight.crashed else "Disarming motors"))
        return texts

    def parameters(self) -> dict[str, float]:
        """Return the parameters of the autopilot that describe this craft and its controller, by ArduPilot's names."""
        cascade = self.flight.setup.cascade
        parameters = super().parameters()
        parameters["MOT_THST_HOVER"] = round(self.flight.hover_thrust, 4)
        for axis, gain in zip(("RLL", "PIT", "YAW"), cascade.angle_p, strict=True):
            parameters[f"ATC_ANG_{axis}_P"] = gain
        for axis, gains in (("RLL", cascade.roll_rate), ("PIT", cascade.pitch_rate), ("YAW", cascade.yaw_rate)):
            for letter, gain in zip("PID", gains, strict=True):
                parameters[f"ATC_RAT_{axis}_{letter}"] = gain
            # As in `simulation._kernels`: only the derivative of the error is filtered, the integral is unlimited.
            parameters |= {f"ATC_RAT_{axis}_{name}": value for name, value in RATE_FILTERS.items()}
        return parameters
