"""Match objects of a reference world to bodies of a twin, as a tracker of the twin's assets would."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import metrics, transforms

SAMPLES = 2000
"""Number of points on each true surface."""


def twin_from_truth(bundle: TaskBundle, world: World) -> Pose:
    """T_world_reference: the reference world in the twin's, related by the robot, which exists in both.

    It includes every error of the twin: of its support plane, and of the robot's calibration.

    Raises:
        RuleError: The world has no robot.
    """
    if world.stand is None:
        raise RuleError(
            "the reference world has no robot",
            code="DXB-B240",
            hint="give `reference.world` option `robot` with the robot's place",
        )
    return bundle.base_pose @ world.stand.pose().inverse()


def match(bundle: TaskBundle, things: Mapping[str, Thing], twin_from_truth: Pose, farthest_m: float) -> dict[str, str]:
    """Match each body of the task to the true object at its position, one to one.

    Surfaces are compared by Chamfer-L1: half the sum of both mean nearest distances.

    Args:
        bundle: The task in the twin.
        things: Movable objects of the reference world.
        twin_from_truth: T_world_reference, see `twin_from_truth`.
        farthest_m: Maximum distance of a pair [m].

    Raises:
        RuleError: A body has no match.
    """
    truth = {name: _points(thing, twin_from_truth) for name, thing in things.items()}
    apart = np.full((len(bundle.objects), len(truth)), np.inf)
    for row, thing in enumerate(bundle.objects.values()):
        found = transforms.apply(thing.pose.matrix, thing.points.astype(np.float64))
        for column, points in enumerate(truth.values()):
            apart[row, column] = metrics.chamfer_and_f(found, points, farthest_m)[0]
    near = np.where(apart <= farthest_m, 1.0 - apart / farthest_m, 0.0)
    names = list(truth)
    bodies = list(bundle.objects)
    pairs = {bodies[row]: names[column] for row, column in metrics.match(near, 1e-9)} if names else {}
    for row, body in enumerate(bodies):
        if body not in pairs:
            best = int(np.argmin(apart[row])) if names else -1
            nearest = f"`{names[best]}`, {100 * apart[row, best]:.1f} cm away" if names else "none"
            raise RuleError(
                f"nothing in the reference world is `{body}` of the twin",
                code="DXB-B241",
                facts={"nearest thing": nearest, "things": listing(names)},
                hint="compare the robot's pose in both, or leave the asset out of the twin",
            )
    return {body: pairs[body] for body in bodies}


def _points(thing: Thing, twin_from_truth: Pose) -> np.ndarray:
    pose = twin_from_truth @ thing.pose
    surface = metrics.sample_surface(thing.surface.vertices.astype(np.float64), thing.surface.faces, SAMPLES, seed=0)
    return transforms.apply(pose.matrix, surface)
