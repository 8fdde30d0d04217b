"""Action noise (Eq. 4d of the paper): it disturbs what is executed, never the label."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.operator import Aim, Command
from dextera_build.sim.experts.motion import minimum_jerk

FADE = 8
"""Control steps in which noise fades in and out, at rest at both ends; a jump, also one of the speed, would exceed what
a robot can accelerate."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the action noise."""

    position_m: float = 0.0
    """Noise of the palm's position, per axis [m]."""
    rotation_rad: float = 0.0
    """Noise of the palm's rotation vector, per axis, applied from the right [rad]."""
    finger_rad: float = 0.0
    """Noise of every finger joint [rad]."""
    correlation: float = 0.97
    """Correlation of noise in consecutive steps, 0..1; white noise would shake the arm."""
    in_contact: bool = False
    """Whether to add noise in segments with intended contact, too."""


class Disturbance:
    """Noise of one episode: a stationary second-order process, with the same spread in every step.

    The process has a double pole, so that its velocity has no jumps, as a first-order process would have in every step.

    Args:
        noise: Its spread.
        seed: Seed of the episode.
    """

    def __init__(self, noise: Noise, seed: int) -> None:
        self._noise = noise
        self._random = np.random.default_rng([seed, 1])
        self._values: dict[str, np.ndarray] = {}
        self._faded = 0.0

    @property
    def is_still(self) -> bool:
        """Whether it changes no command."""
        return not (self._noise.position_m or self._noise.rotation_rad or self._noise.finger_rad)

    def on(self, command: Command) -> Command:
        """The command with noise, which is faded out where contact is intended."""
        quiet = (command.contact or command.nears) and not self._noise.in_contact
        self._faded = float(np.clip(self._faded + (-1.0 if quiet else 1.0) / FADE, 0.0, 1.0))
        gain = minimum_jerk(self._faded)
        drawn = {name: gain * self._next(name, 6 + len(aim.fingers)) for name, aim in command.aims.items()}
        if not gain:
            return command
        aims = {name: _disturbed(aim, drawn[name], self._noise) for name, aim in command.aims.items()}
        return replace(command, aims=aims)

    def _next(self, limb: str, size: int) -> np.ndarray:
        """The next value (size,) of a limb's process, of unit variance."""
        wanted = self._noise.correlation
        pole = (1.0 - np.sqrt(1.0 - wanted**2)) / wanted if wanted else 0.0
        drawn = self._random.standard_normal(size)
        if limb not in self._values:
            rest = np.sqrt(1.0 - wanted**2) * self._random.standard_normal(size)
            self._values[limb] = np.array([wanted * drawn + rest, drawn])
            return drawn
        before, last = self._values[limb]
        spread = np.sqrt((1.0 - pole**2) ** 3 / (1.0 + pole**2))
        now = 2.0 * pole * last - pole**2 * before + spread * drawn
        self._values[limb] = np.array([last, now])
        return np.asarray(now)


def _disturbed(aim: Aim, value: np.ndarray, noise: Noise) -> Aim:
    """A limb's target with the noise `value` (6 + H,), standard normal."""
    shift = transforms.rigid(lie.rotation(value[3:6] * noise.rotation_rad), np.zeros(3))
    palm = aim.palm @ shift
    palm[:3, 3] += value[:3] * noise.position_m
    return Aim(palm, aim.fingers + value[6:] * noise.finger_rad)
