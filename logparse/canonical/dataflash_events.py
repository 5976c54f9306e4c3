"""Modes and events of DataFlash logs."""

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.canonical.modes import COPTER_EVENTS, COPTER_SUBSYSTEMS, ardupilot_mode
from logparse.canonical.series import distinct

Messages = Mapping[str, pd.DataFrame]


def modes(messages: Messages, firmware: str | None) -> pd.DataFrame | None:
    """Flight modes from MODE; one row for each change."""
    if "MODE" not in messages or not len(messages["MODE"]):
        return None
    frame = messages["MODE"]
    column = next((name for name in ("ModeNum", "Mode") if name in frame), None)
    if column is None:
        return None
    values = frame[column]
    return mode_table(frame.index.to_numpy(), (_mode_name(value, firmware) for value in values))


def _mode_name(value: object, firmware: str | None) -> str:
    """Mode by number; text logs of 3.1 have the name instead."""
    try:
        return ardupilot_mode(int(float(str(value))), firmware)
    except (ValueError, OverflowError):
        return str(value).strip().upper().replace(" ", "_")


def mode_table(t: np.ndarray, names: Iterable[str]) -> pd.DataFrame:
    """Modes with their times, repetitions dropped."""
    order, times = distinct(t)
    mode = pd.Series(np.asarray(list(names), dtype=object)[order], index=pd.Index(times, name="t"), dtype="str")
    return mode[mode != mode.shift()].to_frame("mode")


def event_table(parts: Iterable[tuple[np.ndarray, Iterable[str], Iterable[str]]]) -> pd.DataFrame | None:
    """Join lists of (times, events, details) into one table in time order; an event repeated without change goes."""
    times: list[float] = []
    events: list[str] = []
    details: list[str] = []
    for t, names, texts in parts:
        for time, name, text in zip(t, names, texts, strict=True):
            times.append(float(time))
            events.append(name)
            details.append(text)
    order, distinct_times = distinct(times)
    if not len(order):
        return None
    table = pd.DataFrame(
        {
            "event": pd.array([events[k] for k in order], dtype="str"),
            "detail": pd.array([details[k] for k in order], dtype="str"),
        },
        index=pd.Index(distinct_times, name="t", dtype=np.float64),
    )
    return table[(table != table.shift()).any(axis=1)]


def changes(frame: pd.DataFrame, state: np.ndarray, on: str, off: str) -> tuple[np.ndarray, list[str], list[str]]:
    """Events where a state changes; the state at the start counts only when it is on."""
    changed = np.append(state[:1], state[1:] != state[:-1])
    names = [on if value else off for value in state[changed]]
    return frame.index.to_numpy()[changed], names, ["" for _ in names]


def events(messages: Messages) -> pd.DataFrame | None:
    """Events of EV, ERR, ARM and the texts of MSG."""
    parts: list[tuple[np.ndarray, Iterable[str], Iterable[str]]] = []
    if "EV" in messages:
        frame = messages["EV"]
        ids = numbers(frame, "Id")
        known = np.isfinite(ids)
        names = [COPTER_EVENTS.get(int(k), f"EVENT_{int(k)}") for k in ids[known]]
        parts.append((frame.index.to_numpy()[known], names, ("" for _ in names)))
    if "ERR" in messages:
        frame = messages["ERR"]
        subsystems, codes = numbers(frame, "Subsys"), numbers(frame, "ECode")
        known = np.isfinite(subsystems) & np.isfinite(codes)
        texts = [
            f"{COPTER_SUBSYSTEMS.get(int(subsystem), f'SUBSYSTEM_{int(subsystem)}')} {int(code)}"
            for subsystem, code in zip(subsystems[known], codes[known], strict=True)
        ]
        parts.append((frame.index.to_numpy()[known], ("ERROR" for _ in texts), texts))
    if "ARM" in messages and "EV" not in messages:
        frame = messages["ARM"]
        names = ["ARMED" if state else "DISARMED" for state in numbers(frame, "ArmState")]
        parts.append((frame.index.to_numpy(), names, ("" for _ in names)))
    if "MSG" in messages and "Message" in messages["MSG"]:
        frame = messages["MSG"]
        texts = [str(text).strip("\x00 ") for text in frame["Message"]]
        parts.append((frame.index.to_numpy(), ("MESSAGE" for _ in texts), texts))
    return event_table(parts)
