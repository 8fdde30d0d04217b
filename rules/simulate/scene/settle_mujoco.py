"""simulate.settle with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.scenes.scene import Scene, Settled, SettleReport
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.worlds import settle as runner

if TYPE_CHECKING:
    from .settle import SettleOptions

BACKEND = Backend(
    summary="MuJoCo, implicit integration, from keyframe `home`",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def let_go(ctx: Context, scene: Scene, common: SettleOptions, options: Options) -> SettleReport:
    """Simulate `scene` and evaluate every body by the limits in `common`."""
    run = runner.let_go(scene.model, scene.bodies, common.seconds)
    bodies = tuple(
        Settled(
            name=motion.name,
            drift_m=motion.drift_m,
            tilt_rad=motion.tilt_rad,
            penetration_m=max(motion.penetration_m, motion.depth_m),
            joint_drift=motion.joints,
            resting=not run.diverged and rests(motion, common),
        )
        for motion in run.motions
    )
    passed = all(body.resting for body in bodies) and run.energy_change <= common.max_energy
    return SettleReport(
        bodies=bodies,
        seconds=common.seconds,
        energy_j=run.energy_j,
        energy_change=run.energy_change,
        passed=passed,
    )


def rests(motion: runner.Motion, options: SettleOptions) -> bool:
    """Whether a body ends at rest, upright, in place, with unchanged joints, and without penetrating another body."""
    within = (
        motion.tilt_rad <= options.max_tilt_rad,
        motion.drift_m <= options.max_drift_m,
        motion.depth_m <= options.max_depth_m,
        motion.joints <= options.max_joint_rad,
        motion.speed_m_s <= options.max_speed_m_s,
        motion.turn_rad_s <= options.max_turn_rad_s,
    )
    return all(within)
