"""What may go wrong at a simulated robot, after its first command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from dextera_build.formats.ros.reading import SECOND

FaultKind = Literal[
    "joint_states_stop", "joint_states_late", "joint_states_lost", "pictures_stop", "pictures_freeze", "poses_stop",
    "stamps_jump", "stamps_back", "nan", "sign_flipped", "joint_missing", "joint_renamed", "cut",
]  # fmt: skip
FAULTS: tuple[FaultKind, ...] = get_args(FaultKind)
JUMP_NS = 3 * SECOND
"""Jump of the stamps in faults `stamps_jump` and `stamps_back` [ns]."""
LATE_S = 0.4
"""Delay of joint states in fault `joint_states_late` [s]."""
LOST = 0.99
"""Fraction of joint states that do not arrive in fault `joint_states_lost`."""


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong."""

    kind: FaultKind
    """What."""
    at_s: float
    """When it begins, after the first command [s]."""
    for_s: float = float("inf")
    """How long it lasts [s]."""
