"""Write a scene description with its robots as MJCF; the robots are attached by MuJoCo."""

from __future__ import annotations

from collections.abc import Collection

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.sim.model import compose, fixed_bodies, mjcf


def write(description: SceneDescription, fixed: Collection[str] = ()) -> Folder:
    """`scene.xml` and its files, every robot fixed to the world at its pose; keyframe `home` has its home position.

    Args:
        description: The scene.
        fixed: Names of objects whose root cannot move.

    Raises:
        RuleError: MuJoCo rejects a robot or the combination.
    """
    made = mjcf.write(description.model_copy(update={"attachments": ()}))
    if fixed:
        made = fixed_bodies.hold(made, fixed)
    for each in description.attachments:
        made = compose.with_robot(made, each.robot, each.pose.matrix, prefix=each.prefix, keeps_cameras=True)
    return made
