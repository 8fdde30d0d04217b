"""demonstrate.synthesize in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Shard
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError
from dextera_build.policy import layout
from dextera_build.policy.added import of_specs
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import synthesis
from dextera_build.sim.experts.adapt import Timing
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import SETTLE_RAD_S, Filters
from dextera_build.sim.experts.noise import Noise
from dextera_build.sim.experts.recovery import Recovery
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of

if TYPE_CHECKING:
    from .synthesize import SynthesizeOptions

BACKEND = Backend(
    summary="MuJoCo; inverse kinematics by mink",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp"),
    extra="learn",
)


def synthesize(
    ctx: Context,
    bundle: TaskBundle,
    sources: Episodes,
    shard: Shard,
    terms: tuple[TermSpec, ...],
    common: SynthesizeOptions,
    options: Options,
) -> Episodes:
    """Attempt episodes until the shard is full, or the attempts are used up."""
    driver = Driver(Environment(bundle, terms=of_specs(terms, ctx.companion)), SETTLE_RAD_S)
    manner = _manner(common)
    items: dict[str, Episode] = {}
    failures: dict[str, Episode] = {}
    attempts = 0
    while len(items) < shard.count and attempts < common.tries * shard.count:
        seed = seed_of(shard.seed, shard.first, attempts)
        attempts += 1
        try:
            start = driver.environment.draw(seed)
        except RuleError:
            if attempts == 1:
                raise
            continue
        episode = synthesis.synthesise(driver, sources, start, seed, manner)
        if episode.success:
            items[f"{shard.first + len(items):05d}"] = episode
        else:
            failures[f"{shard.first:05d}-{attempts:03d}"] = episode
        ctx.progress(len(items), shard.count, f"{attempts} attempts")
    return layout.gathered(bundle, items, failures, attempts, terms)


def _manner(options: SynthesizeOptions) -> synthesis.Manner:
    noise = Noise(
        position_m=options.noise_position_m,
        rotation_rad=float(np.radians(options.noise_rotation_deg)),
        finger_rad=float(np.radians(options.noise_finger_deg)),
        correlation=options.noise_correlation,
        in_contact=options.noise_in_contact,
    )
    return synthesis.Manner(
        noise=noise,
        filters=Filters(
            lag_m=options.lag_m,
            press_n=options.press_n,
            displaced_m=options.displaced_m,
            depth_m=options.depth_m,
            grip_m=options.grip_m,
            speed=options.speed,
            acceleration=options.acceleration,
            hold_s=options.hold_s,
        ),
        timing=Timing(options.speed_m_s, float(np.radians(options.turn_deg_s))),
        nearest=options.nearest,
        soften=options.soften,
        recovery=Recovery(options.recover, options.recover_position_m, float(np.radians(options.recover_rotation_deg))),
    )
