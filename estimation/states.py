"""The error states of the strapdown filter and the noise that drives them.

Error states are additive except attitude: the true body-to-NED rotation is ``exp([phi]x) R`` with `phi` a rotation
about the NED axes. A state that no sensor observes is switched off by zero variance; the layout never changes.
"""

from dataclasses import dataclass

import numpy as np

#: First index of each block of the error state (Groves 2013, ch. 14, with sensor errors appended).
POSITION = 0
VELOCITY = 3
ATTITUDE = 6
GYRO_BIAS = 9
ACCEL_BIAS = 12
BARO_BIAS = 15
HARD_IRON = 16
GPS_ERROR = 19
CLIMB_ERROR = 22
BARO_WANDER = 23
FIELD = 24
TERRAIN = 27
SIZE = 28
#: What wanders about zero (Gauss-Markov) from `GPS_ERROR` on: three of the receiver's position, climb, barometer.
WANDERING = slice(GPS_ERROR, FIELD)

#: Column names of the sensor errors in `Trajectory.states` and `.sigma`, in the order of the error state.
SENSOR_ERROR_COLUMNS: dict[str, str] = {
    "b_gx": "rad/s; gyro bias about body x",
    "b_gy": "rad/s",
    "b_gz": "rad/s",
    "b_ax": "m/s^2; accelerometer bias along body x",
    "b_ay": "m/s^2",
    "b_az": "m/s^2",
    "b_baro": "m; baro altitude less height above the origin",
    "b_mx": "T; hard iron along body x that the autopilot's calibration left",
    "b_my": "T",
    "b_mz": "T",
    "e_n": "m; slowly varying GPS position error, north",
    "e_e": "m; east",
    "e_d": "m; down",
    "e_vd": "m/s; slowly varying error of the vertical velocity of the GPS",
    "w_baro": "m; what pressure about the flying craft makes of the baro altitude, beside b_baro",
    "m_n": "T; Earth's magnetic field at the place, north",
    "m_e": "T; east",
    "m_d": "T; down",
    "h_terrain": "m; height of the ground under the craft above the origin, as the range finder sees it",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """What the filter believes of the sensors of a small autopilot, before it has seen the log.

    The values are those of sensor classes (data sheets and the literature), not of any log. White noise of the IMU is
    raised to what the log itself shows (`timing.noise_density`): vibration and aliasing exceed the sensor's own
    noise by far. White noise of the aiding sensors is scaled by the innovations (`filter.matched_noise`).
    """

    #: White noise floor, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz). ICM-20689 class: 0.006 deg/s and 150 ug, per sqrt(Hz).
    gyro: float = 1.0e-4
    accel: float = 1.5e-3
    #: Random walk of the biases, rad/s/sqrt(s) and m/s^2/sqrt(s): warming and bias instability, about 30 deg/h and 0.1
    #: mg in a minute.
    gyro_bias_walk: float = 2.0e-5
    accel_bias_walk: float = 1.5e-4
    #: 1-sigma turn-on bias, rad/s and m/s^2, after the autopilot's calibration.
    gyro_bias: float = 0.01
    accel_bias: float = 0.1
    baro: float = 0.15  #: White noise of the pressure altitude, m.
    #: Drift of the pressure altitude, m/sqrt(s): weather and warming, about 1 m in ten minutes.
    baro_walk: float = 0.04
    #: 1-sigma of what propeller wash, ground effect and airspeed make of it, m, and for how long they last, s. It is
    #: bounded: as a walk of 0.6 m/sqrt(s) it left a climb of 20 m to a receiver's velocity (peterbarker 1.BIN).
    baro_wander: float = 0.1
    baro_wander_time: float = 5.0
    baro_bias: float = 30.0  #: 1-sigma offset of the baro's zero from the origin, m.
    mag: float = 5.0e-7  #: White noise of the magnetometer, T: noise, quantisation, motor currents.
    hard_iron: float = 3.0e-6  #: 1-sigma hard iron left by the calibration, T.
    hard_iron_walk: float = 2.0e-8  #: T/sqrt(s).
    #: 1-sigma of the world magnetic field's model north, east and down, T: the World Magnetic Model's own error at the
    #: ground, crust included (Chulliat et al. 2020, WMM2020 report, section 3).
    field: tuple[float, float, float] = (1.31e-7, 0.94e-7, 1.57e-7)
    #: Correlation time of the Gauss-Markov error of GPS positions and heights, s: the carrier-smoothed single-frequency
    #: receivers of this class wander over one to a few minutes.
    gps_error_time: float = 100.0
    gps_height_time: float = 100.0
    #: Share of the reported accuracy that is the slowly varying error, of positions and of heights.
    gps_error_share: float = 0.98
    gps_height_share: float = 0.98
    #: The same of the vertical velocity, and how long it lasts, s: real receivers climb or sink by 0.05 to 0.25 m/s for
    #: minutes, at a stated 0.3 to 0.6. Taken for white it outvoted barometer and height together, by 25 m in six
    #: minutes (erlerobot 5-12-2014_218).
    gps_climb_share: float = 0.5
    gps_climb_time: float = 100.0
    #: Share of the reported accuracy that is white from sample to sample; squares of both shares add up to one.
    gps_white_share: float = 0.2
    #: White noise of the range finder, m: the lidars of this class read to 0.02-0.1 m over grass and concrete.
    range_finder: float = 0.06
    terrain: float = 30.0  #: 1-sigma of the ground's height about the origin, m.
    terrain_walk: float = 0.1  #: How the ground rises and falls along the way, m/sqrt(m): 1 m within 100 m of a field.
    #: How well the time of a sample is known, s; it counts as noise while the measured quantity changes.
    gps_jitter: float = 0.01
    baro_jitter: float = 0.01
    mag_jitter: float = 0.01
    range_jitter: float = 0.02
    #: Accuracy taken where the receiver reports none (1-sigma), m, m and m/s.
    h_acc: float = 1.0
    v_acc: float = 1.8
    s_acc: float = 0.2
    gate: float = 5.0  #: Innovations beyond this many sigma are refused.

    def random_walks(self) -> np.ndarray:
        """Growth of each error state's variance per second, without the IMU's white noise, shape (28,).

        That of the ground is per metre flown.
        """
        q = np.zeros(SIZE)
        q[GYRO_BIAS : GYRO_BIAS + 3] = self.gyro_bias_walk**2
        q[ACCEL_BIAS : ACCEL_BIAS + 3] = self.accel_bias_walk**2
        q[BARO_BIAS] = self.baro_walk**2
        q[HARD_IRON : HARD_IRON + 3] = self.hard_iron_walk**2
        q[TERRAIN] = self.terrain_walk**2
        return q

    def jitter(self) -> np.ndarray:
        """Uncertainty of the time of each kind of measurement (see `observations.KIND_NAMES`), s, shape (9,)."""
        gps = self.gps_jitter
        return np.array([gps, gps, gps, gps, self.baro_jitter, self.mag_jitter, gps, gps, self.range_jitter])

    def wander_times(self) -> np.ndarray:
        """Correlation time of each of the errors `WANDERING`, s, shape (5,)."""
        position = self.gps_error_time
        return np.array([position, position, self.gps_height_time, self.gps_climb_time, self.baro_wander_time])

    def wander_sizes(self) -> np.ndarray:
        """1-sigma of each of the errors `WANDERING`: by the accuracy stated, the barometer's in m; shape (5,)."""
        position = self.gps_error_share
        return np.array([position, position, self.gps_height_share, self.gps_climb_share, self.baro_wander])
