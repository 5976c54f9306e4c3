"""Split of a craft's flights into training and held-out ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Exclusion(StrEnum):
    """Why a flight is excluded from training."""

    POSITION_UNKNOWN = "position-unknown"
    POSITION_POOR = "position-poor"
    EXCITATION_UNKNOWN = "excitation-unknown"
    LITTLE_EXCITATION = "little-excitation"


@dataclass(frozen=True, slots=True)
class TrainingExclusion:
    """A flight that must not train: the kind of reason, and the reason with its numbers, as a clause."""

    exclusion: Exclusion
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Names of flights that train and that judge, in order of name."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    judging: tuple[str, ...]  #: Those held out that models are judged on.
    unused: Mapping[str, str] = field(default_factory=dict)  #: Flights that do neither, and why.
    never_train: Mapping[str, TrainingExclusion] = field(default_factory=dict)  #: Flights that judge only, and why.
    sentence: str = ""  #: How the two were chosen, with the numbers.
