"""simulate.describe: the twin in a simulator-independent description."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.rule import Context, rule
from dextera_build.sim.model import description


@rule(version=3, packages=("scipy",))
def describe(
    ctx: Context, assets: Collection[Asset], background: Background, support: Support, camera: Camera
) -> SceneDescription:
    """Return bodies, joints, geoms, lights and the camera of the twin in the world frame [m, kg, rad].

    `simulate.scene` and `simulate.usd` write the same description; a rule of a project may change it and write its own
    format.
    """
    found = description.parted(assets.items, background)
    made = description.describe(found, background, camera, support.camera_pose.matrix)
    ctx.metric("bodies", len(made.objects))
    ctx.say(", ".join(made.facts()))
    return made
