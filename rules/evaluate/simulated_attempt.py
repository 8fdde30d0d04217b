"""One trial of a policy from a random start in MuJoCo, with exact poses or through a cell."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.errors import RuleError
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Acting, Look, closed_loop
from dextera_build.sim.runtime.tracked_cell import TrackedCell


def simulated(
    environment: Environment, policy: Acting, seed: int, watching: TrackedCell | None, look: Look | None = None
) -> Attempt:
    """Run `policy` from the start of `seed`; a start that cannot be drawn is excluded.

    Args:
        environment: The world.
        policy: The policy.
        seed: Seed of the start.
        watching: Measures the world and judges success from the measurements; None: poses are exact.
        look: Renders the picture for the policy.
    """
    try:
        start = environment.draw(seed)
    except RuleError as error:
        return Attempt(seed=seed, excluded=error.message)
    environment.staged = True
    environment.begin(start)
    placed = environment.object_poses().astype(np.float32)
    episode = closed_loop(environment, policy, start, look, watching)
    if watching is not None:
        watching.settle()
    stage = int(environment.judge.stage[0])
    return Attempt(seed=seed, episode=episode, placed=placed, stage=stage, sighting=watching and watching.sighting)
