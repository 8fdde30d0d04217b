"""Paths of several limbs that share one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.sim.control.operator import FREE, Aim, Command, Part
from dextera_build.sim.experts.motion import between, minimum_jerk
from dextera_build.sim.experts.retime import pose_at


@dataclass(frozen=True)
class Path:
    """Motion of some limbs from where they are, in N steps."""

    limbs: tuple[str, ...]
    """The limbs."""
    palms: np.ndarray
    """(N + 1, L, 4, 4) T_base_palm; the first ones are where the hands are."""
    fingers: tuple[np.ndarray, ...]
    """Of every limb (N + 1, H) [rad]."""
    least: np.ndarray
    """(N,) shortest durations of the steps [control periods]."""
    labels: Sequence[Mapping[str, Part]]
    """What the limbs do in each step."""

    def started(self) -> Path:
        """Without a first step that moves nothing."""
        if len(self.least) < 2 or not np.allclose(self.palms[0], self.palms[1], atol=1e-9):
            return self
        fingers = tuple(np.delete(each, 1, axis=0) for each in self.fingers)
        return Path(self.limbs, np.delete(self.palms, 1, axis=0), fingers, self.least[1:], self.labels[1:])

    def led(self, count: int) -> Path:
        """With `count` free steps, at rest at both ends, in place of the first one."""
        if count <= 1:
            return self
        parts = [minimum_jerk(step / count) for step in range(count)]
        pairs = list(zip(self.palms[0], self.palms[1], strict=True))
        palms = np.array([[between(*pair, part) for pair in pairs] for part in parts])
        fingers = tuple(np.array([each[0] + part * (each[1] - each[0]) for part in parts]) for each in self.fingers)
        free = {limb: Part(part.segment, FREE, part.contact) for limb, part in self.labels[0].items()}
        return Path(
            self.limbs,
            np.concatenate([palms, self.palms[1:]]),
            tuple(np.concatenate([way, each[1:]]) for way, each in zip(fingers, self.fingers, strict=True)),
            np.concatenate([np.ones(count - 1), self.least]),
            [free] * (count - 1) + list(self.labels),
        )

    @property
    def free(self) -> int:
        """Number of steps at its beginning in which all limbs move freely; what several hold binds them together."""
        alone = len(self.limbs) == 1
        parts = (
            all(part.frame == FREE and (alone or not part.contact) for part in each.values()) for each in self.labels
        )
        return next((number for number, each in enumerate(parts) if not each), len(self.labels))

    def begun(self, palms: np.ndarray) -> Path:
        """With other poses (K, L, 4, 4) of the palms at its beginning."""
        return replace(self, palms=np.concatenate([palms, self.palms[len(palms) :]]))

    def palms_at(self, place: float) -> np.ndarray:
        """T_base_palm (L, 4, 4) at a place 0..N."""
        return np.array([pose_at(self.palms[:, number], place) for number in range(len(self.limbs))])

    def command(self, place: float) -> Command:
        """The command at a place, above 0 and up to N."""
        step = int(np.ceil(place - 1e-9)) - 1
        row, parts = min(int(place), len(self.least) - 1), self.labels[max(step, 0)]
        share = place - row
        aims = {}
        for number, (limb, fingers) in enumerate(zip(self.limbs, self.fingers, strict=True)):
            posture = fingers[row] + share * (fingers[row + 1] - fingers[row])
            aims[limb] = Aim(pose_at(self.palms[:, number], place), posture)
        first = parts[self.limbs[0]]
        contact = any(part.contact for part in parts.values())
        differ = parts if len(set(parts.values())) > 1 else {}
        return Command(aims, first.segment, first.frame, contact, differ)
