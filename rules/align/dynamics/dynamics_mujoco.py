"""align.dynamics in MuJoCo: the arms of the twin are simulated with the commands that the robot was sent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses, transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import at_home, compile_folder

from . import phases
from .arm import Arm, Run
from .estimates import estimated, prior_of
from .fit import fit, rows_of

if TYPE_CHECKING:
    from .dynamics import DynamicsOptions

BACKEND = Backend(
    summary="MuJoCo: the arms alone, with rigid hands", profiles=("cpu",), packages=("mujoco",), extra="twin"
)
SHORTEST = 20
"""Number of control periods below which a recording is left out."""
SPAN_S = 0.2
"""Half the time over which accelerations are taken [s]."""


def estimate(
    ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], common: DynamicsOptions, options: Options
) -> DynamicsEstimate:
    """Estimate everything from at most `common.runs` of these recordings, evenly chosen."""
    usable = [episode for episode in episodes if len(episode.executed) >= SHORTEST]
    ctx.check(
        bool(usable),
        f"no recording has {SHORTEST} control periods",
        recordings=len(episodes),
        hint="record motions of some seconds",
    )
    count = min(common.runs, len(usable))
    chosen = [usable[number * len(usable) // count] for number in range(count)]
    arm, reach_m = Arm(bundle), reach_of(bundle)
    runs = [run_of(arm, bundle, episode, reach_m) for episode in chosen]
    if not any(rows_of(run).any() for run in runs):
        ctx.fail(
            "no part of these recordings can be used",
            why=runs[0].phases.why,
            hint="record from before the hand is near the object, see the docs of `align.dynamics`",
        )
    weighed = None if common.mass_kg is None else (common.mass_kg, common.mass_sigma)
    found = fit(arm, runs, prior_of(bundle, arm, weighed), common.rounds)
    return estimated(bundle, arm, runs, found, common.narrower, weighed=weighed is not None)


def run_of(arm: Arm, bundle: TaskBundle, episode: Episode, reach_m: float) -> Run:
    """One recording as the simulation of the arms needs it."""
    names = [joint.name for joint in bundle.robot.joints]
    columns = [names.index(joint.name) for joint in arm.joints]
    joints = episode.joints[:, columns].astype(np.float64)
    targets = np.concatenate([episode.start.ctrl[None, : len(names)], episode.executed])[:, columns].astype(np.float64)
    thing = bundle.objects[bundle.task.object]
    row = list(bundle.objects).index(bundle.task.object)
    seen = np.array([poses.to_matrix(pose) for pose in episode.objects[:, row]])
    base = bundle.base_pose.matrix
    palms = arm.palms(joints)
    found = phases.phases(palms, seen, thing.points, base[2, :3], reach_m, bundle.task.control_hz)
    ways = np.zeros((len(joints), 3)) if found.sliding is None else found.sliding @ base[:3, :3].T
    points = transforms.apply(base, seen[:, :3, :3] @ arm.payload.centre + seen[:, :3, 3])
    rates = np.zeros((len(joints), 3))
    if found.sliding is not None:
        hand = transforms.apply(base, palms[found.limb][:, :3, 3])
        rates = _accelerations(hand, bundle.task.control_hz)
        rates -= (rates @ [0.0, 0.0, 1.0])[:, None] * [0.0, 0.0, 1.0]
    return Run(joints, targets[: len(joints) + 1], found, points, ways, rates)


def _accelerations(places: np.ndarray, hz: float) -> np.ndarray:
    """Second derivative (T, 3) of places [m], over 0.4 s, because those of joints are noisy."""
    half = max(1, round(SPAN_S * hz))
    padded = np.concatenate([np.repeat(places[:1], half, axis=0), places, np.repeat(places[-1:], half, axis=0)])
    return np.asarray((padded[2 * half :] - 2.0 * places + padded[: -2 * half]) * (hz / half) ** 2)


def reach_of(bundle: TaskBundle) -> float:
    """Distance of the farthest fingertip of a hand at home from its palm [m], and a margin."""
    data = at_home(compile_folder(bundle.model))
    robot = bundle.robot
    far = [
        float(
            np.linalg.norm(data.site(ROBOT + robot.frames[tip]).xpos - data.site(ROBOT + robot.frames[limb.palm]).xpos)
        )
        for limb in robot.limbs.values()
        if limb.palm
        for tip in limb.tips
    ]
    return max(far, default=0.1) + 0.02
