"""Multisines as a Lua script of ArduPilot's scripting: rate targets in GUIDED, with its limits in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.loops.chirps import Limits
from sysid.loops.filters import Floats

_SCRIPT = """\
-- rotorid design: orthogonal multisines on roll, pitch and yaw rate (Morelli), in mode GUIDED.
-- Measured in firmware: scripts run at 25 to 90 Hz with gaps up to 0.24 s, so nothing above {top:.1f} Hz is asked for.
-- The craft's height is held by this script, roughly: start at {height:.0f} m or more above ground, in calm air.
{expected}
-- Limits: ends beyond {lean:.0f} deg of lean, beyond 5 m from the height at its start, and when the mode is left.
-- Needs SCR_ENABLE 1. Switch to GUIDED in hover to start; switch to LOITER or ALT_HOLD at any time to end.
local GUIDED, LOITER = 4, 5
local HOVER, LEAN, HEIGHT, PERIOD, PERIODS = {hover:.4f}, math.rad({lean:.1f}), 5.0, {period:.1f}, 3
local LEVEL = 0.5 -- 1/s: returns the craft to level, slowly beside the sines
local sines = {{
{tables}
}}
local started, height, ended

local function value(list, t)
  local sum = 0.0
  for _, one in ipairs(list) do
    sum = sum + one[2] * math.sin(2.0 * math.pi * one[1] * t + one[3])
  end
  return sum
end

local function finish(why)
  ended = true
  vehicle:set_mode(LOITER)
  gcs:send_text(4, "rotorid multisine: " .. why)
end

local function update()
  if vehicle:get_mode() ~= GUIDED or not arming:is_armed() then
    started, ended = nil, nil
    return update, 200
  end
  if ended then
    return update, 200
  end
  local position, velocity = ahrs:get_relative_position_D_home(), ahrs:get_velocity_NED()
  if not position or not velocity then
    finish("no height")
    return update, 200
  end
  local now = millis():tofloat() * 0.001
  if not started then
    started, height = now, -position
    gcs:send_text(6, "rotorid multisine: started")
  end
  local t = now - started
  local roll, pitch = ahrs:get_roll(), ahrs:get_pitch()
  if math.abs(roll) > LEAN or math.abs(pitch) > LEAN then
    finish("lean")
  elseif math.abs(-position - height) > HEIGHT then
    finish("height")
  elseif t > PERIODS * PERIOD then
    finish("done")
  else
    local fade = math.min(1.0, t / 2.0, (PERIODS * PERIOD - t) / 2.0)
    local rates = {{}}
    for k = 1, 3 do
      rates[k] = fade * value(sines[k], t)
    end
    local climb = -velocity:z()
    local throttle = HOVER + 0.04 * (height + position) - 0.08 * climb
    throttle = math.max(0.6 * HOVER, math.min(1.5 * HOVER, throttle / (math.cos(roll) * math.cos(pitch))))
    vehicle:set_target_rate_and_throttle(
      math.deg(rates[1] - LEVEL * roll), math.deg(rates[2] - LEVEL * pitch), math.deg(rates[3]), throttle)
  end
  return update, 10
end

return update()
"""

#: Samples per period in which peaks are looked for.
_SAMPLES = 4096


def multisine_script(
    sines: Sequence[Multisine],
    scales: Sequence[float],
    hover: float,
    limits: Limits,
    expected: Sequence[tuple[str, float]],
) -> str:
    """Write the script."""
    tables = []
    for sine, scale in zip(sines, scales, strict=True):
        parts = [
            f"{{{hz:.4f},{amplitude:.6f},{phase:.5f}}}"
            for hz, amplitude, phase in zip(
                sine.hz, sine.amplitude * scale, np.mod(sine.phase, 2.0 * np.pi), strict=True
            )
        ]
        tables.append("  {" + ", ".join(parts) + "},")
    return _SCRIPT.format(
        top=max(float(sine.hz[-1]) for sine in sines),
        height=limits.height_m,
        lean=limits.lean_deg,
        hover=hover,
        period=sines[0].period,
        tables="\n".join(tables),
        expected="\n".join(
            f"-- Predicted standard deviation of {name}: {100.0 * sigma:.2g} %" for name, sigma in expected
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Multisine:
    """A sum of sines ``amplitude sin(2 pi hz t + phase)``, periodic in `period` s and zero at its start."""

    hz: Floats
    amplitude: Floats
    phase: Floats
    period: float

    def at(self, t: Floats) -> Floats:
        """Return values at times, s."""
        return np.asarray(np.sin(2.0 * np.pi * np.outer(t, self.hz) + self.phase) @ self.amplitude)


def _peak_factor(x: Floats) -> float:
    """Return (max - min) / (2 sqrt 2 rms): 1 for a sine."""
    return float((x.max() - x.min()) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(x**2))))


def orthogonal_multisines(inputs: int, low: float, high: float, period: float) -> tuple[Multisine, ...]:
    """Design multisines of unit peak for several inputs: harmonics of 1 / period dealt out in turn."""
    harmonics = np.arange(np.ceil(low * period), np.floor(high * period) + 1.0)
    return tuple(_optimised(harmonics[k::inputs], period) for k in range(inputs))


def _optimised(harmonics: Floats, period: float) -> Multisine:
    """Choose phases: Schroeder's, then clipping in time and keeping the phases of what results.

    That lowers the peak factor (Van der Ouderaa et al. 1988).
    """
    count = len(harmonics)
    order = np.arange(1, count + 1)
    bins = harmonics.astype(int)

    def over_a_period(phase: Floats) -> Floats:
        spectrum = np.zeros(_SAMPLES // 2 + 1, complex)
        spectrum[bins] = -1j * np.exp(1j * phase) * _SAMPLES / 2.0 / np.sqrt(count)
        return np.fft.irfft(spectrum)

    best = phase = -np.pi * order * (order - 1) / count
    x = signal = over_a_period(phase)
    for _ in range(300):
        limit = 0.85 * np.max(np.abs(signal))
        phase = np.angle(np.fft.rfft(np.clip(signal, -limit, limit))[bins]) + 0.5 * np.pi
        signal = over_a_period(phase)
        if _peak_factor(signal) < _peak_factor(x):
            best, x = phase, signal
    start = int(np.flatnonzero((x[:-1] <= 0.0) & (x[1:] > 0.0))[0]) / _SAMPLES
    shifted = np.mod(best + 2.0 * np.pi * harmonics * start, 2.0 * np.pi)
    return Multisine(harmonics / period, np.full(count, 1.0 / np.sqrt(count) / np.max(np.abs(x))), shifted, period)
