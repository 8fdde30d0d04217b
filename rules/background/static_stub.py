"""background.static without image processing: holes get the support's mean colour, the surface is two triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import cameras, lie, transforms
from dextera_build.rule import Backend, Context, Options

from .behind import Behind
from .boxes import support_box
from .surface import plane_depth

if TYPE_CHECKING:
    from .static import StaticOptions

BACKEND = Backend(summary="one colour for holes, a flat rectangle for the scene", profiles=("stub",))


def clean(
    ctx: Context,
    photograph: Photograph,
    depth: np.ndarray,
    support: Support,
    instances: InstanceMap,
    robot: np.ndarray,
    behind: Behind | None,
    common: StaticOptions,
    options: Options,
) -> Background:
    """Fill holes with one colour and project the photograph onto the support."""
    hole = (instances.labels > 0) | robot
    pixels = photograph.rgb.pixels.copy()
    pixels[hole] = np.round(pixels[~hole].mean(axis=0)).astype(np.uint8) if (~hole).any() else 128
    camera = photograph.camera
    k = camera.matrix()
    plane = plane_depth(camera, support.camera_pose.matrix)
    filled = np.where(hole, np.where(np.isfinite(plane), plane, 0.0), depth).astype(np.float32)
    box = support_box(support.polygon, 0.0, common.thickness_m)
    x, y = box.half_size[:2]
    turn = lie.about_z(box.yaw)[:2, :2]
    flat = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) @ turn.T + box.centre[:2]
    corners = np.concatenate([flat, np.zeros((4, 1))], axis=1)
    seen = cameras.project(transforms.apply(transforms.invert(support.camera_pose.matrix), corners), k)
    size = (camera.width, camera.height)
    uv = np.clip(np.stack([(seen[:, 0] + 0.5) / size[0], 1 - (seen[:, 1] + 0.5) / size[1]], axis=1), 0, 1)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    image = Image(pixels=pixels)
    mesh = Mesh(vertices=corners.astype(np.float32), faces=faces, uv=uv[faces].astype(np.float32), texture=image)
    boxes = (support_box(support.polygon, common.margin_m, common.thickness_m),)
    return Background(image=image, depth=DepthImage(depth=filled), mesh=mesh, boxes=boxes)
