"""Fake trials without simulation, for the stub backends: valid shapes, no motion."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Origin, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.geometry import poses
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.primitives import catalogue

STEPS = 4


def fake_trial(
    bundle: TaskBundle, seed: int, origin: Origin, *, success: bool, terms: Collection[TermSpec] = ()
) -> Episode:
    """A trial of `STEPS` control periods in which robot and objects stay as photographed; added `terms` are 0."""
    layout = of_bundle(bundle, terms=terms)
    joints = np.array([joint.home for joint in bundle.robot.joints], np.float64)
    base_from_world = bundle.base_pose.inverse()
    motions = [(base_from_world @ thing.pose).matrix for thing in bundle.objects.values()]
    placed = np.array([poses.from_matrix(motion) for motion in motions])
    inner = np.array([position for thing in bundle.objects.values() for position in thing.positions])
    tips = len(bundle.robot.tips)
    still = np.tile(joints.astype(np.float32), (STEPS, 1))
    return Episode(
        start=Start(
            seed=seed,
            qpos=np.concatenate([placed.ravel(), inner, joints]),
            ctrl=joints,
            mass_scale=dict.fromkeys(bundle.objects, 1.0),
            friction={name: thing.friction for name, thing in bundle.objects.items()},
            gain_scale=1.0,
        ),
        origin=origin,
        success=success,
        reason="" if success else "nothing was simulated",
        action=still,
        executed=still.copy(),
        hand=np.tile(np.array([0, 0, 0, 1, 0, 0, 0], np.float32), (STEPS, len(bundle.robot.limbs), 1)),
        terms={
            "joints": still.copy(),
            "objects": np.tile(placed.astype(np.float32).reshape(1, len(motions), 7), (STEPS, 1, 1)),
            "displacement": np.tile(inner.astype(np.float32), (STEPS, 1)),
            "contact": np.zeros((STEPS, tips, 3), np.float32),
            **{term.name: np.zeros((STEPS, *layout.shape(term)), np.float32) for term in layout.added},
        },
        goal=np.array(catalogue.of(bundle.task).goal.numbers(base_from_world.matrix), np.float32),
    )
