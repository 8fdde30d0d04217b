"""align.apply: a scene transformed by its alignment."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene_fit import AlignedScene
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy",))
def apply(
    ctx: Context,
    motion: Similarity,
    splats: Splats | None = None,
    mesh: Mesh | None = None,
    onto: Pose | None = None,
) -> AlignedScene:
    """Return the Gaussians and the collision mesh in metres, by one transform, in the camera's frame or that of `onto`.

    `motion` is T_camera_scene of align.scene, including the scale; with `onto`, T_world_camera, X_world =
    T_world_camera T_camera_scene [s_G X_scene, 1]. The scale is applied to the scene first, never to the camera.
    """
    if splats is None and mesh is None:
        ctx.fail("there is nothing to move", hint="give `splats`, `mesh` or both")
    if onto is not None:
        ctx.check(
            onto.child == motion.parent, f"`onto` is T_{onto.parent}_{onto.child}, T_..._{motion.parent} is needed"
        )
        covariance = None
        if onto.covariance is not None:
            covariance = np.zeros((7, 7))
            covariance[:6, :6] = onto.covariance
        first = Similarity(
            parent=onto.parent, child=onto.child, matrix=onto.matrix, scale=1.0, covariance=covariance, stamp=onto.stamp
        )
        motion = first @ motion
    made = AlignedScene.of(motion, splats, mesh)
    ctx.metric("scale", motion.scale)
    ctx.say(", ".join(made.facts()))
    return made
