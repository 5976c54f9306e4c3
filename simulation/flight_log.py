"""Write simulated flights as the logs that ArduCopter 4.7 and a ground station would have written.

The two tables below are the writer: each message with the samples ("stream") that it is made of, in a DataFlash log the
format, units and multipliers of its fields, and what the fields hold: a column of the stream, `column*factor`, or a
number. A log has the messages whose streams it has. What a simulation without an on-board estimator cannot know (XKF1
and its like) is left out. Values are rounded to a resolution far above the last bit, so that how NumPy vectorises the
conversions does not show in a log.
"""

import dataclasses
import datetime as dt
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.signal import lfilter

from logparse.dataflash.writer import MessageTable, write_dataflash
from logparse.mavlink.writer import write_tlog as write_mavlink
from simulation._kernels import FLYING, LANDING
from simulation.atmosphere import GRAVITY
from simulation.instruments import RATE_FILTERS, InstrumentedFlight, Instruments, attitude_angles
from simulation.mission import CHIRP_AXES

_DATAFLASH = """
MSG texts QZ s- F- Message=text
PARM parameters QNff s--- F--- Name=name Value=value Default=value
ORGN origins QBLLe s#DUm F-GGB Type=type Lat=lat Lng=lon Alt=alt
MODE modes QMBB s--- F--- Mode=mode ModeNum=mode Rsn=reason
ARM arming QBIBB s---- F---- ArmState=state ArmChecks=0 Forced=0 Method=method
EV events QB s- F- Id=event
ERR errors QBB s-- F-- Subsys=subsystem ECode=code
IMU imu QBffffffIIfBBHH s#EEEooo--O--zz F-000000-----00
    I=0 GyrX=gyro_x GyrY=gyro_y GyrZ=gyro_z AccX=accel_x AccY=accel_y AccZ=accel_z EG=0 EA=0 T=temperature GH=1 AH=1
    GHz=sampled_hz AHz=sampled_hz
VIBE motors QBfffI s#ooo- F-000- IMU=0 VibeX=shake VibeY=shake VibeZ=shake Clip=clips
GPS gps QBBIHBcLLeffffB s#-s-S-DUmnhnh- F--C-0BGGB000--
    I=0 Status=status GMS=week_second GWk=week NSats=satellites HDop=hdop Lat=lat_deg Lng=lon_deg Alt=alt Spd=speed
    GCrs=course_deg VZ=sink Yaw=0.0 U=1
GPA gps QBCCCCfBIHeHH s#-mmnd-ssm-- F-BBBB0-CCB--
    I=0 VDop=1.3 HAcc=horizontal_accuracy VAcc=vertical_accuracy SAcc=speed_accuracy YAcc=0.0 VV=1 SMS=boot_s
    Delta=period AEl=alt RTCMFU=0 RTCMFD=0
BARO baro QBfffcfIffBf s#mmPOnsmO-P F-000B0C?0-0
    I=0 Alt=altitude AltAMSL=altitude_amsl Press=pressure Temp=celsius CRt=climb SMS=boot_s Offset=0.0
    GndTemp=ground_celsius H=1 CPress=pressure
MAG mag QBhhhhhhhhhBI s#GGGGGGGGG-s F-CCCCCCCCC-F
    I=0 MagX=mag_x*1e4 MagY=mag_y*1e4 MagZ=mag_z*1e4 OfsX=0 OfsY=0 OfsZ=0 MOX=0 MOY=0 MOZ=0 Health=1 S=boot_s
BAT battery QBfffffcfBBB s#vvAaXOw%-% F-000C0?0000
    Inst=0 Volt=volt VoltR=rested Curr=ampere CurrTot=ampere_hours EnrgTot=energy Temp=0.0 Res=resistance
    RemPct=percent_left H=1 SH=0
ATT attitude QffffffB sddddhh- F000000-
    DesRoll=roll_ref_deg Roll=roll_deg DesPitch=pitch_ref_deg Pitch=pitch_deg DesYaw=heading_ref Yaw=heading
    AEKF=estimator
RCOU motors QHHHHHHHHHHHHHH sYYYYYYYYYYYYYY F--------------
    C1=m1 C2=m2 C3=m3 C4=m4 C5=m5 C6=m6 C7=m7 C8=m8 C9=0 C10=0 C11=0 C12=0 C13=0 C14=0
CTUN control Qffffffefffhh s----mmmmmmnn F----00B000BB
    ThI=throttle_in ABst=angle_boost ThO=throttle ThH=hover_thrust DAlt=plan_p_d*-1 Alt=nav_p_d*-1 BAlt=baro_altitude
    DSAlt=nan SAlt=0.0 TAlt=0.0 DCRt=climb_ref CRt=nav_v_d*-1
PSCN control Qfffffffff smmmnnnooo F000000000
    DPN=to_p_n TPN=to_p_n PN=nav_p_n DVN=to_v_n TVN=ask_v_n VN=nav_v_n DAN=to_a_n TAN=ask_a_n AN=a_n
PSCE control Qfffffffff smmmnnnooo F000000000
    DPE=to_p_e TPE=to_p_e PE=nav_p_e DVE=to_v_e TVE=ask_v_e VE=nav_v_e DAE=to_a_e TAE=ask_a_e AE=a_e
PSCD control Qfffffffff smmmnnnooo F000000000
    DPD=to_p_d TPD=to_p_d PD=nav_p_d DVD=to_v_d TVD=ask_v_d VD=nav_v_d DAD=to_a_d TAD=ask_a_d AD=a_d
RATE rates Qfffffffffffff skk-kk-kk-oo-- F?????????BB--
    RDes=w_x_ref_deg R=turn_x_deg ROut=out_roll PDes=w_y_ref_deg P=turn_y_deg POut=out_pitch YDes=w_z_ref_deg
    Y=turn_z_deg YOut=out_yaw ADes=a_d_ref*-1 A=a_d*-1 AOut=throttle AOutSlew=0.0
ESC esc QBffffcfcf s#qqvAOaO% F-00--BCB-
    Instance=motor RPM=rpm RawRPM=rpm Volt=volt Curr=ampere Temp=celsius CTot=ampere_hours MotTemp=motor_celsius Err=0.0
SIDS chirps QBfffffff s--ssssss F--------
    Ax=axis Mag=magnitude FSt=start_hz FSp=stop_hz TFin=fade TC=hold TR=duration TFout=fade
SIDD chirping Qfffffffff ss-zkkkooo F---------
    Time=elapsed Targ=chirp F=frequency Gx=gyro_x_deg Gy=gyro_y_deg Gz=gyro_z_deg Ax=accel_x Ay=accel_y Az=accel_z
PIDR terms_roll QffffffB s------- F------- Tar=target Act=actual P=P I=I D=D FF=FF Flags=0
PIDP terms_pitch QffffffB s------- F------- Tar=target Act=actual P=P I=I D=D FF=FF Flags=0
PIDY terms_yaw QffffffB s------- F------- Tar=target Act=actual P=P I=I D=D FF=FF Flags=0
RCIN sticks QH sY F- C3=throttle_us
SIM truth QccCfLLffff sddhmDU---- FBBB0GG0000
    Roll=true_roll_deg Pitch=true_pitch_deg Yaw=true_heading Alt=true_alt Lat=true_lat Lng=true_lon Q1=q_w Q2=q_x Q3=q_y
    Q4=q_z
SIM2 truth QdddfffffI s????????? F?????????
    PN=p_n PE=p_e PD=p_d VN=v_n VE=v_e VD=v_d As=airspeed ASpdU=airspeed UFC=number
"""

_MAVLINK = """
PARAM_VALUE sent_parameters
    param_id=name param_value=value param_type=9 param_count=count param_index=number
HEARTBEAT heartbeats
    type=kind autopilot=3 base_mode=base_mode custom_mode=mode system_status=status mavlink_version=3
SYSTEM_TIME seconds time_unix_usec=unix_us time_boot_ms=boot_ms
ATTITUDE control
    time_boot_ms=boot_ms roll=roll pitch=pitch yaw=yaw rollspeed=turn_x pitchspeed=turn_y yawspeed=turn_z
GLOBAL_POSITION_INT control
    time_boot_ms=boot_ms lat=nav_lat*1e7 lon=nav_lon*1e7 alt=nav_alt*1e3 relative_alt=nav_p_d*-1e3 vx=nav_v_n*1e2
    vy=nav_v_e*1e2 vz=nav_v_d*1e2 hdg=centidegrees
LOCAL_POSITION_NED control time_boot_ms=boot_ms x=nav_p_n y=nav_p_e z=nav_p_d vx=nav_v_n vy=nav_v_e vz=nav_v_d
SERVO_OUTPUT_RAW motors
    port=0 servo1_raw=m1 servo2_raw=m2 servo3_raw=m3 servo4_raw=m4 servo5_raw=m5 servo6_raw=m6 servo7_raw=m7
    servo8_raw=m8
RAW_IMU control
    xacc=milli_g_x yacc=milli_g_y zacc=milli_g_z xgyro=gyro_x*1e3 ygyro=gyro_y*1e3 zgyro=gyro_z*1e3 xmag=mag_x*1e7
    ymag=mag_y*1e7 zmag=mag_z*1e7
GPS_RAW_INT gps
    time_usec=valid_us fix_type=status lat=lat_deg*1e7 lon=lon_deg*1e7 alt=alt*1e3 eph=80 epv=130 vel=centispeed
    cog=centicourse satellites_visible=14 alt_ellipsoid=alt*1e3 h_acc=horizontal_mm v_acc=vertical_mm vel_acc=speed_mm_s
SCALED_PRESSURE baro press_abs=hectopascal temperature=celsius*100
VFR_HUD display
    airspeed=ground_speed groundspeed=ground_speed heading=whole_heading throttle=whole_throttle alt=nav_alt
    climb=nav_v_d*-1
SYS_STATUS status voltage_battery=voltage*1e3 current_battery=current*1e2 battery_remaining=percent_left
SIMSTATE control
    roll=true_roll pitch=true_pitch yaw=true_yaw xacc=f_x yacc=f_y zacc=f_z xgyro=w_x ygyro=w_y zgyro=w_z
    lat=true_lat*1e7 lng=true_lon*1e7
STATUSTEXT texts severity=6 text=short
"""

#: Flight modes of ArduCopter.
_STABILIZE, _AUTO, _GUIDED, _SYSTEMID = 0, 3, 4, 25


class _Message(NamedTuple):
    """A row of a table; `sources` by field, without TimeUS."""

    stream: str
    sources: dict[str, str]
    form: str = ""
    units: str = ""
    multipliers: str = ""


def _parsed(table: str) -> dict[str, _Message]:
    rows: list[list[str]] = []
    for line in table.strip().splitlines():
        if line.startswith(" "):
            rows[-1] += line.split()
        else:
            rows.append(line.split())
    messages = {}
    for name, stream, *words in rows:
        layout = [word for word in words if "=" not in word]
        messages[name] = _Message(stream, dict(word.split("=") for word in words if "=" in word), *layout)
    return messages


_ON_BOARD, _TELEMETRY = _parsed(_DATAFLASH), _parsed(_MAVLINK)

Streams = Mapping[str, pd.DataFrame]


@dataclass(frozen=True, slots=True, kw_only=True)
class Logging:
    """What is logged how often; the rest at ArduPilot's usual 10 Hz."""

    imu: float = 50.0  #: Rows of IMU per second.
    rate: float = 10.0  #: Rows of ATT and RATE per second.
    pid: float = 0.0  #: Rows of each of PIDR, PIDP and PIDY per second; 0: none.
    esc: float = 0.0  #: Rows of ESC per second and motor; 0: the speed controllers do not report.


def write_bin(path: Path, log: InstrumentedFlight, logging: Logging = Logging()) -> None:
    """Write a mission as a DataFlash log, truth rows (SIM, SIM2) at 25 Hz."""
    streams = _instruments(log, logging.imu, logging.esc) | _decisions(log) | _chirps(log)
    if logging.pid:
        streams |= _terms(log, logging.pid)
    streams |= {
        "control": _control(log, 10.0),
        "attitude": _control(log, logging.rate),
        "rates": _rates(log, logging.rate),
    }
    _write(path, streams, log.boot)


def write_open_loop(path: Path, log: Instruments) -> None:
    """Write a flight that no ArduPilot flew: instruments, motors, truth, and of the autopilot the true attitude."""
    rows = _degrees(log.rows(10.0), "roll", "pitch", "yaw")
    heading = rows["yaw_deg"] % 360.0
    attitude = rows.assign(
        roll_ref_deg=rows["roll_deg"],
        pitch_ref_deg=rows["pitch_deg"],
        heading_ref=heading,
        heading=heading,
        estimator=0,
    )
    streams = _instruments(log, imu=50.0, esc=50.0) | {"attitude": attitude}
    streams["modes"] = _frame([0.0], mode=[_GUIDED], reason=[1])
    _write(path, streams | {"arming": _frame([0.0], state=[1], method=[2])}, log.boot)


def write_tlog(path: Path, log: InstrumentedFlight) -> None:
    """Write a mission as a `.tlog`; receive times are the times of sending (a link without delay)."""
    streams = _instruments(log, imu=50.0, esc=0.0) | _ground_station(log)
    tables = []
    for name, entry in _TELEMETRY.items():
        frame = streams[entry.stream]
        index = pd.Index(frame.index.to_numpy(dtype=float) + log.boot, name="t")
        tables.append((name, pd.DataFrame(_values(entry.sources, frame), index=index).round(6)))
    write_mavlink(path, tables, log.start_utc - dt.timedelta(seconds=log.boot))


def message(name: str, t: npt.ArrayLike, columns: Mapping[str, object], digits: int | None = None) -> MessageTable:
    """Return rows of a DataFlash message at times `t` [s] on the boot clock, with those of its fields that are given.

    Scalars are repeated; `digits` are decimals to which floating-point fields are rounded.
    """
    _, sources, form, units, multipliers = _ON_BOARD[name]
    known = ["TimeUS", *sources]
    kept = [known.index(label) for label in ("TimeUS", *columns)]
    time_us = np.rint(np.asarray(t, dtype=float) * 1e6).astype(np.uint64)
    frame = pd.DataFrame({"TimeUS": time_us, **columns})
    if digits is not None:
        rounded = [known[k] for k in kept if form[k] in "fd" and frame[known[k]].dtype.kind == "f"]
        frame[rounded] = frame[rounded].round(digits)
    form, units, multipliers = ("".join(ids[k] for k in kept) for ids in (form, units, multipliers))
    return name, form, units, multipliers, frame


def _write(path: Path, streams: Streams, boot: float) -> None:
    tables = []
    for name, entry in _ON_BOARD.items():
        if entry.stream in streams:
            frame = streams[entry.stream]
            t = frame.index.to_numpy(dtype=float) + boot
            tables.append(message(name, t, _values(entry.sources, frame), digits=6))
    write_dataflash(path, tables)


def _values(sources: Mapping[str, str], stream: pd.DataFrame) -> dict[str, object]:
    """Return the values of fields; a motor that the craft does not have puts out nothing."""
    values: dict[str, object] = {}
    for label, source in sources.items():
        column, _, factor = source.partition("*")
        if column in stream:
            values[label] = stream[column].to_numpy() * float(factor) if factor else stream[column].to_numpy()
        else:
            values[label] = 0.0 if re.fullmatch(r"m\d", column) else float(source)
    return values


def _frame(t: npt.ArrayLike, **columns: npt.ArrayLike) -> pd.DataFrame:
    return pd.DataFrame(columns, index=pd.Index(np.asarray(t, dtype=float), name="t"))


def _degrees(rows: pd.DataFrame, *names: str) -> pd.DataFrame:
    """Add angles and rates in degrees."""
    return rows.assign(**{f"{name}_deg": np.degrees(rows[name].to_numpy()) for name in names})


def _instruments(log: Instruments, imu: float, esc: float) -> dict[str, pd.DataFrame]:
    """Return what the log is of, its sensors, motors and truth; IMU and ESC rows at these rates [Hz], 0 for none."""
    times, texts = zip(*log.messages(), strict=True)
    parameters, place, inertial = log.parameters(), log.place, log.sensors.inertial
    values = np.array(list(parameters.values()), dtype=float)
    celsius = log.baro["temperature"] - 273.15
    motors, truth = log.rows(10.0), _truth(log, 25.0)
    speeds = motors[[f"w{k}" for k in range(1, len(log.vehicle.rotors) + 1)]].to_numpy()
    hover = log.vehicle.hover_speed(place.gravity, place.atmosphere.density_at(0.0))
    noise = inertial.accel_noise + inertial.accel_vibration * (speeds * speeds).mean(axis=1) / hover**2
    streams = {
        "texts": _frame(times, text=texts, short=[text[:50] for text in texts]),
        "parameters": _frame(np.zeros(len(values)), name=list(parameters), value=values),
        "origins": _frame([0.0, 0.0], type=[0, 1], lat=place.lat_deg, lon=place.lon_deg, alt=place.alt),
        "imu": log.rows(imu).assign(
            temperature=float(round(celsius.iloc[0] + 15.0, 2)), sampled_hz=round(log.imu_rate)
        ),
        "motors": motors.assign(shake=noise * math.sqrt(0.5 * log.imu_rate)),
        "gps": _receiver(log),
        "baro": log.baro.assign(
            altitude=log.pressure_altitude(),
            altitude_amsl=log.pressure_altitude() + place.alt,
            pressure=log.baro["pressure"].round(2),
            hectopascal=(log.baro["pressure"] / 100.0).round(4),
            celsius=celsius,
            ground_celsius=float(round(celsius.iloc[0], 2)),
            climb=-np.interp(log.baro.index, log.truth.index, log.truth["v_d"]),
            boot_s=log.baro.index + log.boot,
        ),
        "mag": log.mag.assign(boot_s=log.mag.index + log.boot),
        "battery": _battery(log),
        "truth": truth.assign(number=np.arange(len(truth))),
    }
    return streams | ({"esc": _speed_controllers(log, esc)} if esc else {})


def _receiver(log: Instruments) -> pd.DataFrame:
    gps, errors = log.gps, log.sensors.gps
    v_n, v_e = gps["v_n"].to_numpy(), gps["v_e"].to_numpy()
    speed, course = np.sqrt(v_n * v_n + v_e * v_e), np.degrees(np.arctan2(v_e, v_n)) % 360.0
    horizontal = math.hypot(errors.horizontal_wander, errors.position_noise)
    vertical = math.hypot(errors.vertical_wander, errors.position_noise)
    week_second, week = log.gps_time(gps["t_valid"].to_numpy())
    return gps.assign(
        status=np.where(gps["fix"], 3, 1),
        satellites=np.where(gps["fix"], 14, 3),
        hdop=np.where(gps["fix"], 0.8, 99.99),
        week_second=week_second,
        week=week,
        # The receiver's own time of the sample; the row comes later by the receiver's lag.
        valid_us=np.rint((gps["t_valid"] + log.boot) * 1e6),
        boot_s=gps.index + log.boot,
        period=1.0 / errors.rate,
        speed=np.round(speed, 3),
        course_deg=np.round(course, 3),
        sink=np.round(gps["v_d"], 3),
        centispeed=speed * 1e2,
        centicourse=course * 1e2 % 35999.5,
        horizontal_accuracy=round(horizontal, 2),
        vertical_accuracy=round(vertical, 2),
        speed_accuracy=round(errors.velocity_noise * 2.0, 2),
        horizontal_mm=round(1e3 * horizontal),
        vertical_mm=round(1e3 * vertical),
        speed_mm_s=round(2e3 * errors.velocity_noise),
    )


def _battery(log: Instruments) -> pd.DataFrame:
    battery, pack = log.battery, log.vehicle.battery
    ampere_hours = battery["charge"] / 3600.0
    return battery.assign(
        volt=battery["voltage"].round(3),
        rested=(battery["voltage"] + battery["current"] * pack.resistance).round(3),
        ampere=battery["current"].round(3),
        ampere_hours=ampere_hours,
        energy=(battery["voltage"] * battery["current"]).cumsum() * 0.1 / 3600.0,
        resistance=pack.resistance,
        # As the autopilot does, nothing is left of a pack that gives more than it should hold.
        percent_left=np.floor(100.0 * np.maximum(0.0, 1.0 - ampere_hours / pack.capacity)),
    )


def _speed_controllers(log: Instruments, rate: float) -> pd.DataFrame:
    """Return a row for each motor at `rate` [Hz]: ESCs report their speeds in steps of 6 turns per minute.

    The drives' current is shared among the motors as the cube of their speeds, as their power is.
    """
    rotors = len(log.vehicle.rotors)
    samples = log.truth.iloc[:: round(1.0 / rate / (log.truth.index[1] - log.truth.index[0]))]
    speeds = samples[[f"w{k}" for k in range(1, rotors + 1)]].to_numpy()
    cubes = speeds * speeds * speeds + 1e-9
    current = samples[["current"]].to_numpy() * cubes / cubes.sum(axis=1, keepdims=True)
    rpm = np.round(speeds * 60.0 / (2.0 * math.pi) / 6.0) * 6.0
    celsius = log.place.atmosphere.temperature_at(0.0) - 273.15 + 20.0
    return _frame(
        np.repeat(samples.index, rotors),
        motor=np.tile(np.arange(rotors), len(samples)),
        rpm=rpm.ravel(),
        volt=np.repeat(log.rows(rate)["voltage"], rotors),
        ampere=current.ravel(),
        ampere_hours=(current.cumsum(axis=0) / rate / 3600.0).ravel(),
        celsius=round(celsius, 2),
        motor_celsius=round(celsius + 5.0, 2),
    )


def _truth(log: Instruments, rate: float) -> pd.DataFrame:
    rows = log.rows(rate)
    lat, lon, alt = log.geodetic(rows)
    angles = dict(zip(("true_roll", "true_pitch", "true_yaw"), attitude_angles(rows), strict=True))
    through = [rows[f"v_{axis}"] - rows[f"wind_{axis}"] for axis in "ned"]
    rows = rows.assign(**angles, true_lat=lat, true_lon=lon, true_alt=np.round(alt, 3))
    rows = _degrees(rows, *angles)
    return rows.assign(true_heading=rows["true_yaw_deg"] % 360.0, airspeed=np.sqrt(sum(one * one for one in through)))


def _decisions(log: InstrumentedFlight) -> dict[str, pd.DataFrame]:
    """Return modes, arming and events of a mission."""
    flight, reference = log.flight, log.flight.reference
    # Each chirp is flown in SYSTEMID mode, everything else of the mission in AUTO.
    modes = [(0.0, _STABILIZE, 1), (reference.takeoff, _AUTO, 2)]
    for start, chirp in reference.chirps:
        modes += [(start, _SYSTEMID, 2), (start + chirp.duration, _AUTO, 2)]
    times, numbers, reasons = zip(*modes, strict=True)
    # EV.Id of ArduPilot (LogEvent): armed, auto armed, not landed, landed, disarmed.
    events = {10: reference.arm, 15: reference.takeoff, 28: flight.airborne[0], 18: flight.disarm, 11: flight.disarm}
    # ERR.Subsys of ArduPilot (LogErrorSubsystem) 12 is the crash check, which disarmed.
    crash = {"errors": _frame([flight.disarm], subsystem=12, code=1)} if flight.crashed else {}
    return crash | {
        "modes": _frame(times, mode=numbers, reason=reasons),
        "arming": _frame([reference.arm, flight.disarm], state=[1, 0], method=[2, 12 if flight.crashed else 13]),
        "events": _frame(list(events.values()), event=list(events)),
    }


def _control(log: InstrumentedFlight, rate: float) -> pd.DataFrame:
    """Return what the autopilot believes, wants and does, at this rate [Hz]."""
    rows = log.rows(rate)
    gravity = log.place.gravity
    plan, nav = log.planned(rows), log.navigated(rows)
    active = rows["state"].isin((FLYING, LANDING)).to_numpy()
    rows = rows.join(plan.add_prefix("plan_")).join(nav.add_prefix("nav_"))
    for axis in "ned":
        rows[f"to_p_{axis}"] = np.where(active, plan[f"p_{axis}"], nav[f"p_{axis}"])
        rows[f"to_v_{axis}"] = np.where(active, plan[f"v_{axis}"], 0.0)
        rows[f"to_a_{axis}"] = np.where(active, plan[f"a_{axis}"], 0.0)
        rows[f"ask_v_{axis}"] = np.where(active, rows[f"v_{axis}_ref"], 0.0)
        rows[f"ask_a_{axis}"] = np.clip(rows[f"a_{axis}_ref"], -gravity, gravity)
    rows = _degrees(rows, "roll_ref", "pitch_ref", "yaw_ref", "roll", "pitch", "yaw")
    return rows.assign(
        heading_ref=rows["yaw_ref_deg"] % 360.0,
        heading=rows["yaw_deg"] % 360.0,
        estimator=3,
        hover_thrust=log.flight.hover_thrust,
        climb_ref=np.where(active, -rows["v_d_ref"], 0.0),
        baro_altitude=np.interp(rows.index, log.baro.index, log.pressure_altitude()),
    )


def _rates(log: InstrumentedFlight, rate: float) -> pd.DataFrame:
    """Return the innermost loop and what it puts out; the autopilot controls on rates less its estimate of the bias."""
    rows = _degrees(log.rows(rate), "w_x_ref", "w_y_ref", "w_z_ref", "gyro_x", "gyro_y", "gyro_z")
    bias = np.degrees(log.sensors.inertial.gyro_bias)
    return rows.assign(**{f"turn_{axis}_deg": rows[f"gyro_{axis}_deg"] - bias[k] for k, axis in enumerate("xyz")})


def _terms(log: InstrumentedFlight, rate: float) -> dict[str, pd.DataFrame]:
    """Return the terms of the rate controllers, as `simulation._kernels.pid` forms them in each loop."""
    loop = 1.0 / (2.0 * log.flight.setup.step)
    rows, cascade = log.rows(loop), log.flight.setup.cascade
    smoothing = -math.expm1(-2.0 * math.pi * RATE_FILTERS["FLTD"] / loop)
    added = log.flight.reference.excitation()[: len(rows)]
    gains = {"roll": cascade.roll_rate, "pitch": cascade.pitch_rate, "yaw": cascade.yaw_rate}
    terms = {}
    for k, (axis, (P, _, D)) in enumerate(gains.items()):
        target = rows[f"w_{'xyz'[k]}_ref"].to_numpy()
        actual = rows[f"gyro_{'xyz'[k]}"].to_numpy() - log.sensors.inertial.gyro_bias[k]
        slope = lfilter([smoothing], [1.0, smoothing - 1.0], np.diff(target - actual, prepend=0.0) * loop)
        own = rows[f"out_{axis}"].to_numpy() - added[:, k]
        proportional, derivative = P * (target - actual), D * slope
        frame = _frame(
            rows.index, target=target, actual=actual, P=proportional, I=own - proportional - derivative, D=derivative
        )
        terms[f"terms_{axis}"] = frame.assign(FF=0.0).iloc[:: round(loop / rate)]
    return terms


def _chirps(log: InstrumentedFlight) -> dict[str, pd.DataFrame]:
    """Return what the chirps of a mission were, and what they did, at the rate of the attitude loop."""
    chirps = log.flight.reference.chirps
    if not chirps:
        return {}
    settings = [dataclasses.asdict(chirp) | {"hold": chirp.hold, "duration": chirp.duration} for _, chirp in chirps]
    flown = pd.DataFrame(settings, index=pd.Index([start for start, _ in chirps], name="t"))
    rows = _unfiltered(log)
    parts = []
    for start, chirp in chirps:
        during = rows.loc[start : start + chirp.duration]
        t = during.index.to_numpy() - start
        parts.append(during.assign(elapsed=t, chirp=chirp.signal(t), frequency=chirp.frequency(t)))
    first_axis = 10
    return {
        "chirps": flown.assign(axis=[first_axis + CHIRP_AXES.index(chirp.axis) for _, chirp in chirps]),
        "chirping": pd.concat(parts),
    }


def _unfiltered(log: InstrumentedFlight) -> pd.DataFrame:
    """Return the angle turned through in each attitude loop over its time: two samples of the gyro, not filtered."""
    step, inertial = log.flight.setup.step, log.sensors.inertial
    rows = log.rows(1.0 / (2.0 * step))
    # The sample between two loops lies half-way between theirs.
    turned = rows[["w_x", "w_y", "w_z"]].rolling(2, min_periods=1).mean().to_numpy()
    turned = 0.5 * (rows[["w_x", "w_y", "w_z"]].to_numpy() + turned) + np.array(inertial.gyro_bias)
    white = (inertial.gyro_noise + inertial.gyro_vibration) / math.sqrt(2.0 * 2.0 * step)
    turned += white * np.random.RandomState(log.flight.setup.seed).standard_normal(turned.shape)
    return _degrees(
        rows.assign(gyro_x=turned[:, 0], gyro_y=turned[:, 1], gyro_z=turned[:, 2]), "gyro_x", "gyro_y", "gyro_z"
    )


def _ground_station(log: InstrumentedFlight) -> dict[str, pd.DataFrame]:
    """Return what only telemetry has."""
    flight = log.flight
    rows = _control(log, 10.0).join(_truth(log, 10.0).filter(like="true_"))
    lat, lon, alt = log.geodetic(log.navigated(rows))
    mag = log.mag.reindex(rows.index, method="nearest")
    bias = flight.setup.sensors.inertial.gyro_bias
    control = rows.join(mag).assign(
        boot_ms=np.rint((rows.index + log.boot) * 1e3),
        nav_lat=lat,
        nav_lon=lon,
        nav_alt=alt,
        centidegrees=rows["heading"] * 1e2 % 35999.5,
        ground_speed=np.sqrt(rows["nav_v_n"] ** 2 + rows["nav_v_e"] ** 2),
        whole_heading=np.floor(rows["heading"]),
        whole_throttle=np.floor(rows["throttle"] * 100.0),
        **{f"turn_{axis}": rows[f"gyro_{axis}"] - bias[k] for k, axis in enumerate("xyz")},
        **{f"milli_g_{axis}": rows[f"accel_{axis}"] / GRAVITY * 1e3 for axis in "xyz"},
    )
    unix_start = (log.start_utc - dt.datetime(1970, 1, 1, tzinfo=dt.UTC)).total_seconds()
    seconds = control.iloc[::10]
    parameters = log.parameters()
    number = np.arange(len(parameters))
    beats = log.rows(1.0)
    armed = (beats.index >= flight.reference.arm) & (beats.index < flight.disarm)
    return {
        "control": control,
        "display": control.iloc[::2],
        "seconds": seconds.assign(unix_us=np.rint((unix_start + seconds.index) * 1e6)),
        "status": _battery(log).iloc[::5],
        # Sent one after the other once the link is up, as a ground station asks for them.
        "sent_parameters": _frame(
            0.5 + 0.02 * number,
            name=list(parameters),
            value=list(parameters.values()),
            count=len(number),
            number=number,
        ),
        "heartbeats": _frame(
            beats.index,
            # MAV_TYPE, MAV_MODE_FLAG (custom mode, armed) and MAV_STATE (active, standby).
            kind={4: 2, 6: 13, 8: 14}[len(log.vehicle.rotors)],
            base_mode=np.where(armed, 129, 1),
            mode=np.where(beats.index >= flight.reference.takeoff, _AUTO, _STABILIZE),
            status=np.where(beats["state"].isin((FLYING, LANDING)), 4, 3),
        ),
    }
