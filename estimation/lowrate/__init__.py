"""A trajectory from telemetry: what is fused, how it is filtered and smoothed, and what each row weighs."""

from estimation.lowrate.trajectory import estimate_low_rate

__all__ = ["estimate_low_rate"]
