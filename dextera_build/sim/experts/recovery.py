"""Perturb and recover: the robot leaves its path, and the label leads back to it.

Copies of clean motion do not show a policy what to do when it is off the path. In a perturbation the executed hand
leaves the path by a random displacement. The label stays on the path, then follows, always nearer to the path than the
hand, and meets it at the end; from there both return to the path together, so that this part of the label was
demonstrated from where the robot is. A label that jumped from the path to the hand would be one that no robot can
follow, and contradict that of the state next to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.operator import Aim, Command, Part
from dextera_build.sim.experts.motion import minimum_jerk

LEAVES, RETURNS = 15, 20
"""Control steps in which the hand leaves its path, and in which it returns to it."""
FOLLOWS = 12
"""Control steps at the end of `LEAVES` in which the label follows the hand."""


@dataclass(frozen=True)
class Recovery:
    """Perturbations of the synthesis."""

    share: float = 0.0
    """Share of the episodes that have one, 0..1."""
    position_m: float = 0.02
    """Standard deviation of the displacement of the palm, per axis [m]."""
    rotation_rad: float = 0.09
    """Standard deviation of its rotation vector, per axis, applied from the right [rad]."""

    def times(self, part: float) -> Recovery:
        """The same with a part 0..1 of the displacement."""
        return Recovery(self.share, part * self.position_m, part * self.rotation_rad)

    def drawn(self, random: np.random.Generator) -> bool:
        """Whether an episode has a perturbation."""
        return bool(random.random() < self.share)


def recovering(commands: Sequence[Command], recovery: Recovery, random: np.random.Generator) -> Iterator[Command]:
    """The commands with one perturbation, anywhere where no contact is intended; unchanged if there is no room.

    Args:
        commands: Motion without contact, then with it.
        recovery: Spread of the displacement.
        random: Source of its place, its time and its amount.
    """
    free = next((number for number, each in enumerate(commands) if each.contact), len(commands))
    room = free - LEAVES - RETURNS
    if room < 0:
        yield from commands
        return
    first = int(random.integers(room + 1))
    away = {limb: _displacement(recovery, random) for limb in commands[0].aims}
    for number, command in enumerate(commands):
        step = number - first + 1
        if 0 < step <= LEAVES:
            off = _displaced(command, away, minimum_jerk(step / LEAVES))
            aims = _displaced(command, away, minimum_jerk(max(0, step - LEAVES + FOLLOWS) / FOLLOWS))
            yield replace(_called(command, "perturb"), aims=aims, off=off)
        elif LEAVES < step <= LEAVES + RETURNS:
            back = _displaced(command, away, 1.0 - minimum_jerk((step - LEAVES) / RETURNS))
            yield replace(_called(command, "recover"), aims=back)
        else:
            yield command


def _displacement(recovery: Recovery, random: np.random.Generator) -> np.ndarray:
    """(6,) displacement [m] and rotation vector [rad]."""
    spread = np.repeat([recovery.position_m, recovery.rotation_rad], 3)
    return np.asarray(spread * random.standard_normal(6))


def _displaced(command: Command, away: Mapping[str, np.ndarray], part: float) -> dict[str, Aim]:
    """Targets at a part 0..1 of the displacement from those of a command."""
    found = {}
    for limb, aim in command.aims.items():
        palm = aim.palm @ transforms.rigid(lie.rotation(part * away[limb][3:]), np.zeros(3))
        palm[:3, 3] += part * away[limb][:3]
        found[limb] = Aim(palm, aim.fingers)
    return found


def _called(command: Command, name: str) -> Command:
    parts = {limb: Part(name, part.frame, part.contact) for limb, part in command.parts.items()}
    return replace(command, segment=name, parts=parts)
