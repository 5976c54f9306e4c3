"""What no craft does: drag that pushes and damping that drives are not determined, however small the standard error.

Gains of the wrong sign are motors that stand elsewhere than declared.
"""

from __future__ import annotations

from collections.abc import Mapping

from logparse import Finding, Severity
from sysid.rigid_body.model_record import BodyParameter

#: Standard errors below zero beyond which chance does not explain a sign.
_BEYOND = 2.0

#: Parameters that stand for one effect: where one is impossible, what the other came out as leans on it.
_TOGETHER = (
    *((f"drag_rotor_{axis}", f"drag_quadratic_{axis}") for axis in "xyz"),
    *((f"{axis}_damping",) for axis in ("roll", "pitch", "yaw")),
)


def refuse_impossible(parameters: Mapping[str, BodyParameter]) -> dict[str, BodyParameter]:
    """Return the parameters, those of the air that are below zero not determined, with the reason."""
    out = dict(parameters)
    for names in _TOGETHER:
        wrong = [name for name in names if name in out and _below_zero(out[name])]
        for name in names:
            if not wrong or name not in out:
                continue
            if name in wrong:
                came = f"{out[name].value:.2g} ± {out[name].sigma:.2g}"
                reason = f"it came out below zero ({came}), which no air does: wind or an unknown force passes for it"
            else:
                reason = f"{wrong[0]} came out below zero, and the two are not told apart"
            out[name] = out[name].refused(reason)
    return out


def wrong_turns(parameters: Mapping[str, BodyParameter], spread: Mapping[str, float]) -> tuple[Finding, ...]:
    """Point out gains of the wrong sign: motors permuted, a wrong frame, or a record that its controller made."""
    gains = {axis: parameters[f"{axis}_gain"] for axis in ("roll", "pitch", "yaw")}
    wrong = [axis for axis, gain in gains.items() if gain.used < -_BEYOND * spread.get(gain.name, 0.0)]
    if not wrong:
        return ()
    sure = any(gains[axis].value is not None for axis in wrong)
    return (
        Finding(
            "motor-order",
            Severity.ERROR if sure else Severity.WARNING,
            f"motors {'turn' if sure else 'seem to turn'} the craft the wrong way in {', '.join(wrong)}: "
            + ", ".join(f"{gains[axis].used:.3g} rad/s^2" for axis in wrong)
            + " where it must be positive"
            + ("" if sure else "; the record turns too little to be sure"),
            "check the order of the motor columns, the frame and the signs of the rates",
            {axis: float(gains[axis].used) for axis in wrong},
        ),
    )


def _below_zero(each: BodyParameter) -> bool:
    return each.value is not None and each.sigma is not None and each.value < -_BEYOND * each.sigma
