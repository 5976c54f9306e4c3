"""A small PX4 log of every topic that tables are made of, written after the format's description."""

from __future__ import annotations

import struct

_START = 5_000_000

#: Topic -> its fields after the time stamp; numbers of the topic's k-th row are k and small fractions of it.
_TOPICS = {
    "sensor_combined": "float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_attitude": "float[4] q;",
    "vehicle_attitude_setpoint": "float[4] q_d;",
    "vehicle_local_position": "float x;float y;float z;float vx;float vy;float vz;bool xy_valid;bool z_valid;",
    "vehicle_local_position_setpoint": "float x;float y;float z;",
    "vehicle_angular_velocity": "float[3] xyz;",
    "vehicle_rates_setpoint": "float roll;float pitch;float yaw;",
    "vehicle_torque_setpoint": "float[3] xyz;",
    "vehicle_thrust_setpoint": "float[3] xyz;",
    "vehicle_gps_position": "int32_t lat;int32_t lon;int32_t alt;float eph;float epv;uint64_t time_utc_usec;"
    "uint8_t fix_type;uint8_t satellites_used;",
    "vehicle_air_data": "float baro_alt_meter;float baro_pressure_pa;float baro_temp_celcius;",
    "vehicle_magnetometer": "float[3] magnetometer_ga;",
    "actuator_outputs": "float[16] output;uint32_t noutputs;",
    "battery_status": "float voltage_v;float current_a;float remaining;",
    "esc_status": "uint8_t esc_count;int32_t esc_rpm;",
    "distance_sensor": "float current_distance;",
    "vehicle_status": "uint8_t nav_state;uint8_t arming_state;bool failsafe;",
    "vehicle_land_detected": "bool landed;bool ground_contact;",
}
_CODES = {"float": "f", "int32_t": "i", "uint32_t": "I", "uint64_t": "Q", "uint8_t": "B", "bool": "?"}


def px4_log(rows: int = 25) -> bytes:
    """Return a log of this many rows of each topic, with parameters, information and texts."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", _START), _message("B", bytes(40))]
    parts += [_message("F", f"{topic}:uint64_t timestamp;{fields}".encode()) for topic, fields in _TOPICS.items()]
    parts += [
        _named("I", "char[4] sys_name", b"PX4\0"),
        _named("I", "uint32_t ver_sw_release", struct.pack("<I", 0x010E00FF)),
        _named("P", "int32_t SYS_AUTOSTART", struct.pack("<i", 4001)),
        _named("P", "float EKF2_GPS_DELAY", struct.pack("<f", 110.0)),
    ]
    parts += [_message("A", struct.pack("<BH", 0, k) + topic.encode()) for k, topic in enumerate(_TOPICS)]
    for row in range(rows):
        at = _START + 40_000 * row
        for k, fields in enumerate(_TOPICS.values()):
            parts.append(_message("D", struct.pack("<HQ", k, at + 100 * k) + _row(fields, row)))
        if row % 10 == 5:
            parts.append(_message("L", b"4" + struct.pack("<Q", at) + b"[commander] Takeoff detected\t"))
    return b"".join([*parts, _message("O", struct.pack("<H", 250)), _named("P", "float EKF2_GPS_DELAY", b"\0\0\0\x40")])


def _message(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def _named(kind: str, key: str, value: bytes) -> bytes:
    return _message(kind, bytes([len(key)]) + key.encode() + value)


def _row(fields: str, row: int) -> bytes:
    written = b""
    for field in fields.rstrip(";").split(";"):
        kind, _, count = field.split(" ")[0].partition("[")
        value = 0.1 + 0.01 * row if "output" not in field else 1500.0 + row
        number = value if kind == "float" else bool(row % 2) if kind == "bool" else (row * 1000) % 250
        written += struct.pack(f"<{int(count.rstrip(']') or 1)}{_CODES[kind]}", *[number] * int(count.rstrip("]") or 1))
    return written
