"""What the autopilot itself reported: failsafes, errors and alarms, from its events (ERR, EV) and its texts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from core.catalogue import finding
from core.findings import Happening, Severity
from pipeline.flight.account.readings import Readings

#: Subsystems of ERR by what they are to a pilot, and what to look at. Those without words here are named as logged.
_WORDS: Mapping[str, tuple[str, str]] = {
    "FAILSAFE": ("a failsafe", "Look at the messages around this time."),
    "FAILSAFE_RADIO": ("radio failsafe", "Check the receiver, its antennas and the range."),
    "FAILSAFE_BATTERY": ("battery failsafe", "Land earlier, or replace an aged battery."),
    "FAILSAFE_GPS": ("GPS failsafe", "Look at satellites and interference around this time."),
    "FAILSAFE_GCS": ("ground station failsafe", "Check the telemetry link and FS_GCS_ENABLE."),
    "FAILSAFE_FENCE": ("fence breach", "Look at the fence's limits and at what led the craft there."),
    "FAILSAFE_EKF_INAV": ("EKF failsafe", "Look at vibration, compass and GPS around this time."),
    "FAILSAFE_TERRAIN": ("terrain data failsafe", "Load terrain data before the mission, or plan it without."),
    "FAILSAFE_VIBE": ("vibration failsafe", "Balance propellers and soften the mount of the autopilot."),
    "FAILSAFE_DEADRECKON": ("dead reckoning failsafe", "Look at satellites and interference around this time."),
    "CRASH_CHECK": ("crash check", "Inspect the craft before the next flight."),
    "THRUST_LOSS_CHECK": ("thrust loss check", "Look for a failed motor or propeller, or too much weight."),
    "EKF_CHECK": ("a bad variance of its EKF", "Look at vibration, compass and GPS around this time."),
    "GPS": ("GPS glitch check", "Look at satellites and interference around this time."),
    "COMPASS": ("compass error", "Look at interference of motors and wiring with the compass."),
    "BARO": ("barometer glitch", "Shield the barometer from light and prop wash."),
    "CPU": ("CPU watchdog", "Look at the load of the autopilot."),
}
#: Errors that say how an estimate fared and are told with the sensor behind it, unless nothing else tells it.
_ESTIMATES = frozenset(("EKF_CHECK", "GPS", "EKF_PRIMARY", "COMPASS", "BARO"))
#: Texts of the autopilot (MSG, STATUSTEXT) by the subsystem that they are of; loggers that miss ERR have them.
_TEXTS: Mapping[str, re.Pattern[str]] = {
    "FAILSAFE_BATTERY": re.compile(
        r"low battery|battery failsafe|battery \d+ (is )?(low|critical)|(critical|emergency) battery", re.IGNORECASE
    ),
    "FAILSAFE_RADIO": re.compile(
        r"radio failsafe|rc failsafe|throttle failsafe on|no rc receiver|manual control lost|failsafe enabled: no rc",
        re.IGNORECASE,
    ),
    "FAILSAFE_GCS": re.compile(
        r"gcs failsafe(?!.*(cleared|off))|failsafe enabled: no datalink|data link lost", re.IGNORECASE
    ),
    "FAILSAFE": re.compile(r"failsafe activated", re.IGNORECASE),
    "FAILSAFE_EKF_INAV": re.compile(r"ekf failsafe(?!.*(cleared|off))", re.IGNORECASE),
    "EKF_CHECK": re.compile(r"ekf variance", re.IGNORECASE),
    "FAILSAFE_VIBE": re.compile(r"vibration compensation on", re.IGNORECASE),
    "FAILSAFE_TERRAIN": re.compile(r"terrain data missing", re.IGNORECASE),
    "CRASH_CHECK": re.compile(r"crash: disarming", re.IGNORECASE),
    "THRUST_LOSS_CHECK": re.compile(r"potential thrust loss", re.IGNORECASE),
    "PARACHUTE_RELEASED": re.compile(r"parachute: released", re.IGNORECASE),
}
#: Events (EV) that are alarms.
_ALARMS: Mapping[str, tuple[str, str]] = {
    "LOST_GPS": ("GPS lost", "Look at satellites and interference around this time."),
    "PARACHUTE_RELEASED": ("parachute released", "Inspect the craft before the next flight."),
    "MOTORS_EMERGENCY_STOPPED": ("motors stopped by the emergency switch", "Find who pulled the switch."),
    "AUTOTUNE_FAILED": ("AutoTune failed", "Look at the messages of AutoTune; the gains stay as they were."),
}


@dataclass(frozen=True, slots=True)
class _Report:
    t: float
    subsystem: str
    code: str


def reported_happenings(readings: Readings) -> Iterator[Happening]:
    """Yield what the autopilot reported, what came again and again once; on the ground it is only noted."""
    by_kind: dict[str, list[_Report]] = {}
    for report in _reports(readings):
        by_kind.setdefault(report.subsystem, []).append(report)
    for subsystem, several in by_kind.items():
        flown = [report for report in several if readings.flight.start - 0.5 <= report.t <= readings.flight.stop + 0.5]
        yield _told(subsystem, flown or several, flying=bool(flown))


def _told(subsystem: str, several: list[_Report], *, flying: bool) -> Happening:
    words, advice = _WORDS.get(subsystem) or _ALARMS.get(subsystem) or (f"error {subsystem} {several[0].code}", "")
    first, last = several[0].t, several[-1].t
    again = f", {len(several)} times until {last:.1f} s" if len(several) > 1 else ""
    failsafe = subsystem.startswith("FAILSAFE")
    severity = Severity.INFO
    if flying:
        severity = Severity.ERROR if failsafe or subsystem == "THRUST_LOSS_CHECK" else Severity.WARNING
    return finding(
        "failsafe" if failsafe else "autopilot-error",
        f"The autopilot reported {words}{again}.",
        severity=severity,
        advice=advice if flying else "",
        t=first,
        end=last,
        subsystem=subsystem,
        estimate=subsystem in _ESTIMATES,
        times=len(several),
        what=words,
    )


def _reports(readings: Readings) -> Iterator[_Report]:
    events = readings.tables.events
    if events is None:
        return
    inside = events.loc[readings.belongs.start : readings.belongs.stop]
    last: dict[str, float] = {}
    for t, name, detail in zip(inside.index.to_numpy(np.float64), inside["event"], inside["detail"], strict=True):
        subsystem, code = _parsed(str(name), str(detail))
        # An error and its text are one report.
        if subsystem and float(t) - last.get(subsystem, -np.inf) >= 1.0:
            yield _Report(float(t), subsystem, code)
            last[subsystem] = float(t)


def _parsed(name: str, detail: str) -> tuple[str, str]:
    """Subsystem and code of an event; empty for what is no alarm."""
    if name == "ERROR":
        subsystem, _, code = detail.rpartition(" ")
        # Code 0 says that an earlier error is over; of the estimator's lanes it is the first.
        return ("", "") if code == "0" else (subsystem, code)
    if name in _ALARMS:
        return name, ""
    if name == "MESSAGE":
        return next((kind for kind, text in _TEXTS.items() if text.search(detail)), ""), ""
    return "", ""
