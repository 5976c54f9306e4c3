"""What a log must show before gains are proposed from it: reasons to refuse, each a sentence and what to fly.

Every check returns None where the evidence is there, else the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from logparse import FlightLog
from logparse.craft.log_settings import Need, bit_to_set
from logparse.tables import between
from sysid.frequency.axes import axis_of
from sysid.frequency.excitation import find_chirps, mixer_chirps, ordinary_runs
from sysid.frequency.limits import share_at_limits
from sysid.loops.controller import AXES
from sysid.loops.filters import Floats
from sysid.loops.loop import RateLoop, pid_rows
from sysid.loops.unseen import unseen_mode
from sysid.records.filtering import welch

#: Coherence that counts, the band about crossover in which it must hold (factors of the crossover), and for how much.
COHERENT, AROUND, MOST_OF = 0.8, (0.4, 1.6), 0.9

#: Part of a chirp during which the mixer or the controller may be at a limit.
SATURATED = 0.05

#: Part of the battery's voltage that may go between the first and last third of a chirp where nothing makes up for it
#: (thrust goes with its square).
SAG = 0.02

#: An oscillation: rms of the mixer input in a narrow band, share of its power above 2 Hz, and part of the windows.
NARROW_RMS, NARROW_SHARE, NARROW_PART = 0.02, 0.6, 0.1

#: Windows [s] in which manoeuvres and oscillations are looked for, and the lowest frequency [Hz] of what is noise:
#: below, the craft moves.
WINDOW, LOWEST = 4.0, 2.0

#: Rate of rows [Hz] below which an oscillation of a frame may be beyond half of it.
_FOLDS_BELOW = 200.0

#: How far the peak of an oscillation stands above the power at lower frequencies, where manoeuvres are.
_ABOVE_MANOEUVRES = 3.0

#: How far the two ways to the loop's response may be apart around crossover, in gain and phase (deg).
GAIN_APART, PHASE_APART = 0.12, 8.0

#: Ranges of gains that ArduCopter documents for roll and pitch, and for yaw.
RANGES = {
    "roll": {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05)},
    "pitch": {"P": (0.01, 0.5), "I": (0.01, 2.0), "D": (0.0, 0.05)},
    "yaw": {"P": (0.1, 2.5), "I": (0.01, 1.0), "D": (0.0, 0.02)},
}

#: Parameters of the loops of ArduPilot and PX4.
_OF_THE_LOOPS = (
    *("ATC_RAT_", "ATC_ANG_", "INS_GYRO_FILTER", "INS_HNT", "MOT_THST_EXPO", "SCHED_LOOP"),
    *("MC_ROLL", "MC_PITCH", "MC_YAW", "IMU_GYRO_", "IMU_DGYRO_", "THR_MDL_FAC"),
)


def unfit_log(log: FlightLog) -> str | None:
    """Return why a log cannot show its loops by chirps: none at the mixer, or what `no_one_loop` says."""
    if log.flight is not None and not any(chirp.at_mixer for chirp in find_chirps(log)):
        if log.vehicle.firmware == "PX4":
            return (
                f"{log.path.name} is of PX4, which has no chirp at the mixer: sticks show margins through the craft's "
                "model at most (`rotorid analyze` tells them), which is too little to propose gains or compare flights"
            )
        return (
            f"{log.path.name} has no chirp at the mixer, without which a closed loop does not show its margins; fly "
            "mode SYSTEMID with SID_AXIS 10, 11 and 12 (`rotorid design --for rates` writes the parameters), and log "
            "RATE and PID"
        )
    return no_one_loop(log)


def no_one_loop(log: FlightLog) -> str | None:
    """Return why a log has no one loop per axis: nothing flown, AutoTune, parameters changed in flight."""
    if log.flight is not None and autotuned(log):
        return (
            f"{log.path.name}: AutoTune ran in this log, so that gains changed within it; fly again with the gains it "
            "saved"
        )
    return no_one_setting(log)


def no_one_setting(log: FlightLog) -> str | None:
    """Return why a log has no one setting to go back to: nothing flown, parameters changed in flight."""
    name = log.path.name
    if log.flight is None:
        return f"{name}: the craft did not fly"
    changed = _changed_in_flight(log)
    if changed:
        advice = (
            f"give one flight at a time, as {name}#1"
            if len(log.flights) > 1 and not log.of_one_flight
            else "fly again without changing gains or filters in the air"
        )
        return (
            f"{name}: {', '.join(changed[:4])}{' ...' if len(changed) > 4 else ''} changed in flight or between its "
            f"flights, so that it has no one loop; {advice}"
        )
    return None


def loop_parameters(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return those parameters that decide how the loops answer."""
    return {name: value for name, value in parameters.items() if name.startswith(_OF_THE_LOOPS)}


def other_settings(logs: Sequence[FlightLog]) -> str | None:
    """Return which parameter of the loops two flights do not share; an axis' I may be 0 in its own."""
    first, *others = [(log, loop_parameters(log.parameters_at(log.flight.start))) for log in logs if log.flight]
    for log, flown in others:
        for name in sorted(flown.keys() & first[1].keys()):
            small, large = sorted((abs(first[1][name]), abs(flown[name])))
            without = name.endswith("_I") and small < 0.1 * large
            if large - small > 1e-4 * large and not without:
                return (
                    f"{first[0].path.name} flew with {name} {first[1][name]:g}, {log.path.name} with {flown[name]:g}: "
                    "give flights of one craft with the same gains and filters"
                )
    return None


def autotuned(log: FlightLog) -> bool:
    """Return whether AutoTune ran in a log."""
    modes = log.tables.modes
    named = modes is not None and bool(modes["mode"].astype(str).str.upper().str.contains("AUTOTUNE").any())
    if "autotune_attitude_control_status" in log.messages:  # PX4 logs it whether it runs or not
        states = log.messages["autotune_attitude_control_status"].get("state")
        named |= states is not None and bool((states.to_numpy() > 0).any())
    return named or any(log.messages.counts.get(name, 0) > 0 for name in ("ATUN", "ATDE", "ATNP"))


def _changed_in_flight(log: FlightLog) -> list[str]:
    """Return parameters of the loops that take another value after take-off, or between chirps that count.

    An I only counts during the chirps of its axis, for which the published procedure sets it to 0 in the air.
    """
    if "PARM" not in log.messages or log.flight is None:
        return []
    rows = log.messages["PARM"]
    if not {"Name", "Value"} <= set(rows.columns):
        return []
    rows = rows[rows["Name"].notna()]  # damage leaves numbers where names are, and these have holes
    chirps = [chirp for chirp in find_chirps(log) if chirp.at_mixer]
    start = min([log.flight.start, *(chirp.start for chirp in chirps)])
    stop = max([log.flight.stop, *(chirp.stop for chirp in chirps)])
    own = {f"ATC_RAT_{letters}_I": mixer_chirps(log, axis) for axis, letters in AXES.items()}
    before: dict[str, float] = {}
    changed = []
    for t, name, value in zip(rows.index, rows["Name"].astype(str), rows["Value"].to_numpy(np.float64), strict=True):
        ours = name.startswith(_OF_THE_LOOPS)
        if not ours:
            continue
        alone = own.get(name)
        counts = alone[0].start < t < alone[-1].stop if alone else start < t < stop
        if counts and name in before and before[name] != value and name not in changed:
            changed.append(name)
        before[name] = value
    return changed


def oscillation(log: FlightLog, axis: str) -> str | None:
    """Return where an axis oscillates by itself, outside chirps, narrow and strong, and what to do, in a sentence."""
    column = log.tables.column("rates", axis_of(axis).input)
    if column is None or len(column) < 2:
        return None
    t, values = column.index.to_numpy(np.float64), np.asarray(column, dtype=np.float64)
    rate = 1.0 / float(np.median(np.diff(t)))
    size = int(WINDOW * rate)
    runs = ordinary_runs(log, t, np.isfinite(values)) if size >= 64 else []
    windows = [values[run[: len(run) // size * size]].reshape(-1, size) for run in runs]
    if not sum(map(len, windows)):
        return None
    hz, spectra = welch(np.concatenate(windows), rate, size // 2)
    strength = [_narrow(hz, power) for power in spectra]
    strong = [peak for rms, share, peak in strength if rms > NARROW_RMS and share > NARROW_SHARE]
    if len(strong) < max(NARROW_PART * len(strength), 1.0):
        return None
    peak = float(np.median(strong))
    # Above half of the rate of the rows it shows folded, as one below.
    folded = f" (or at {rate - peak:.0f} Hz and more, which rows at {rate:.0f} Hz fold)" if rate < _FOLDS_BELOW else ""
    return (
        f"{log.path.name}: {axis} oscillates at {peak:.1f} Hz{folded} in {len(strong)} of {len(strength)} windows "
        f"of {WINDOW:.0f} s; land, lower P and D of this axis by a quarter, and fly again"
    )


def _narrow(hz: Floats, power: Floats) -> tuple[float, float, float]:
    """Return rms about the strongest frequency, its share of the power above 2 Hz, and the frequency, Hz."""
    fast = hz > LOWEST
    total = float(power[fast].sum())
    if not total > 0.0:
        return 0.0, 0.0, 0.0
    peak = float(hz[np.argmax(np.where(fast, power, 0.0))])
    below = (hz > 0.0) & (hz < 0.6 * peak)
    if below.any() and power[below].max() > power[hz == peak][0] / _ABOVE_MANOEUVRES:
        return 0.0, 0.0, peak  # the end of a manoeuvre's spectrum, not a peak
    near = fast & (np.abs(hz - peak) < 0.15 * peak + 1.0)
    return float(np.sqrt(power[near].sum() * hz[1])), float(power[near].sum()) / total, peak


def saturation(log: FlightLog, axis: str) -> str | None:
    """Return where the controller or the mixer was at a limit during the axis' chirps, or why that is not seen."""
    if pid_rows(log, axis, ()) is None:
        return (
            f"{log.path.name} has no PID{axis_of(axis).letter} messages, which show when the controller is at a limit; "
            f"{bit_to_set(Need.PID, log)}"
        )
    return limited_chirp(log, axis)


def limited_chirp(log: FlightLog, axis: str) -> str | None:
    """Return where the controller or the mixer was at a limit during the axis' chirps, as far as PID messages tell."""
    frame, chirps = pid_rows(log, axis, ()), mixer_chirps(log, axis)
    if frame is None or not chirps:
        return None
    inside = pd.concat([between(frame, chirp.start, chirp.stop) for chirp in chirps])
    if len(inside) < 16:
        return f"{log.path.name} has no PID{axis_of(axis).letter} messages during the chirp on the {axis} axis"
    # Bits of the flags: mixer at its limit, P and D limited.
    limits = inside["Flags"].to_numpy().astype(int) & 3 if "Flags" in inside else np.zeros(1)
    limited = 100.0 * float(np.mean(limits > 0))
    scaled = 100.0 * float(np.mean(inside["Dmod"].to_numpy(np.float64) < 0.99)) if "Dmod" in inside else 0.0
    if max(limited, scaled) <= 100.0 * SATURATED:
        return None
    why = (
        f"{axis} is at a limit for {limited:.0f} % of its chirp, where the craft does not answer as a linear one"
        if limited > 100.0 * SATURATED
        else f"the slew limit (SMAX) lowers the gains of {axis} for {scaled:.0f} % of its chirp"
    )
    return f"{log.path.name}: {why}; fly the chirp with half of SID_MAGNITUDE"


def motors_limited(log: FlightLog, loop: RateLoop) -> str | None:
    """Report that motors were at a limit during the axis' chirps: what they give then is not what was asked of them."""
    share = share_at_limits(log, [record.plant for record in loop.records])
    if share <= SATURATED:
        return None
    return (
        f"{log.path.name}: a motor was at a limit for {100.0 * share:.0f} % of the chirp on the {loop.axis} axis; "
        "fly it with half of SID_MAGNITUDE, or with less weight"
    )


def sagged(log: FlightLog, axis: str) -> str | None:
    """Report that the battery sank so far during the axis' chirps that the craft answered unlike at their two ends."""
    battery = log.tables.battery
    if battery is None or log.vehicle.battery_voltage_max > 0.0:
        return None
    t, voltage = battery.index.to_numpy(np.float64), battery["voltage"].to_numpy(np.float64)
    for chirp in mixer_chirps(log, axis):
        third = chirp.duration / 3.0
        parts = [
            voltage[(t >= start) & (t <= start + third) & np.isfinite(voltage)]
            for start in (chirp.start, chirp.stop - third)
        ]
        if not all(map(len, parts)):
            continue
        fell = 1.0 - float(np.median(parts[1]) / np.median(parts[0]))
        if fell > SAG:
            return (
                f"{log.path.name}: the battery fell by {100.0 * fell:.0f} % during the chirp on the {axis} axis, and "
                "MOT_BAT_VOLT_MAX is 0, so that the craft answered less at its end than at its start; set "
                "MOT_BAT_VOLT_MAX and MIN, or fly it with a full battery"
            )
    return None


def unsupported(loop: RateLoop) -> str | None:
    """Return why no gains are proposed for an identified loop."""
    if loop.ordinary:
        return at_their_limits(loop)
    return at_their_limits(loop) or weak_band(loop) or two_ways_apart(loop) or unseen_mode(loop)


def at_their_limits(loop: RateLoop) -> str | None:
    """Return which of the flown gains lie at or beyond the range that ArduCopter documents."""
    letters = AXES[loop.axis]
    for name, (low, high) in RANGES[loop.axis].items():
        value = getattr(loop.flown.controller, name)
        if value >= high or (value <= low and name == "P"):
            return (
                f"ATC_RAT_{letters}_{name} = {value:.4g} is at the limit of its range ({low:g} to {high:g}); "
                "look at the propulsion first: no gain is proposed from there"
            )
    return None


def weak_band(loop: RateLoop) -> str | None:
    """Return where the measured band does not carry the margins: coherence, highest frequency, logging rate."""
    margins = loop.margins
    axis = loop.axis
    crossover = margins.crossover_hz.value
    if crossover is None:
        return (
            f"{axis}: no crossover between {loop.hz[0]:.2g} and {loop.hz[-1]:.3g} Hz; let the chirp reach "
            "from a fifth of the crossover to three times of it"
        )
    nyquist = 0.5 / loop.frf.step
    if loop.hz[-1] < 1.6 * crossover:
        reason = "RATE is logged too seldom (aliasing)" if nyquist < 2.2 * crossover else "SID_F_STOP_HZ is too low"
        return f"{axis}: crossover is at {crossover:.1f} Hz and the response ends at {loop.hz[-1]:.1f} Hz: {reason}"
    seen = loop.hz <= loop.plant.seen
    near = seen & (loop.hz > AROUND[0] * crossover) & (loop.hz < AROUND[1] * crossover)
    if not near.any():
        return (
            f"{axis}: the chirp ended at {loop.plant.seen:.1f} Hz, far below the crossover at {crossover:.0f} Hz; fly "
            f"one to {1.6 * crossover:.0f} Hz or more"
        )
    share = float(np.mean(loop.plant.coherence[near] >= COHERENT))
    if share < MOST_OF:
        return (
            f"{axis}: coherence is below {COHERENT} on {100.0 * (1.0 - share):.0f} % of the band around the crossover "
            f"at {crossover:.1f} Hz; fly the chirp in calm air, with a larger SID_MAGNITUDE"
        )
    return None


def two_ways_apart(loop: RateLoop) -> str | None:
    """Return where the loop computed from the craft's response and that measured directly disagree."""
    if loop.measured is None:
        return (
            f"{loop.axis}: the loop cannot be measured beside the one computed: PID messages are missing or do not "
            "match RATE; log PID messages"
        )
    crossover = loop.margins.crossover_hz.value
    if crossover is None:
        return f"{loop.axis}: no crossover within the measured band"
    known = np.isfinite(loop.measured.sigma) & (np.abs(loop.measured.response) > 0.0)
    hz, direct = loop.measured.hz[known], loop.measured.response[known]
    crossover = min(crossover, float(hz[-1]) / 1.5)
    near = (hz > 0.6 * crossover) & (hz < 1.5 * crossover) & (hz >= loop.hz[0]) & (hz <= loop.hz[-1])
    own = np.interp(np.log(hz[near]), np.log(loop.hz), loop.with_settings(loop.flown).response)
    apart = np.log(direct[near] / own)
    gain_apart, phase_apart = float(np.median(np.abs(apart.real))), float(np.degrees(np.median(np.abs(apart.imag))))
    if gain_apart > GAIN_APART or phase_apart > PHASE_APART:
        return (
            f"{loop.axis}: the loop as computed from the parameters and as measured are {100.0 * gain_apart:.0f} % and "
            f"{phase_apart:.0f} deg apart: something in the loop is not as the parameters say"
        )
    return None
