"""What happens after random starts of a task while its robot holds still: nothing, if the start is sound."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.worlds import settle

HELD_S = 0.1
FASTEST_M_S = 0.3
"""Nothing may be faster: a fall by 4 mm."""
DEEPEST_M = 0.002


@dataclass(frozen=True)
class Held:
    """What happened after one start."""

    seed: int
    diverged: bool
    fastest_m_s: float
    """Largest speed of an object."""
    deepest_m: float
    """Largest penetration of an object."""

    @property
    def exploded(self) -> bool:
        """Whether the start was not sound."""
        return self.diverged or self.fastest_m_s > FASTEST_M_S or self.deepest_m > DEEPEST_M

    def __str__(self) -> str:
        what = "diverged" if self.diverged else f"{self.fastest_m_s:.2f} m/s, {1000 * self.deepest_m:.2f} mm deep"
        return f"{self.seed}: {what}"


def held(environment: Environment, starts: Iterable[Start]) -> Iterator[Held]:
    """Simulate every start for `HELD_S`, with the robot holding its position."""
    roots = {int(environment.model.body(name).id) for name in environment.bundle.objects}
    for start in starts:
        environment.begin(start)
        fastest = deepest = 0.0
        for _ in range(max(1, round(HELD_S / environment.period_s))):
            outcome = environment.step(environment.previous_action)
            data, depths = environment.data, settle.penetrations(environment.model, environment.data)
            fastest = max(fastest, *(float(np.linalg.norm(data.cvel[root, 3:])) for root in roots))
            deepest = max(deepest, *(depths.get(root, 0.0) for root in roots))
        diverged = outcome.reason == "the simulation diverged" or not bool(np.isfinite(data.qpos).all())
        yield Held(start.seed, diverged, fastest, deepest)


def drawn(environment: Environment, count: int = 1000) -> Iterator[Start]:
    """Random starts."""
    return (environment.draw(seed) for seed in range(count))
