"""From the empty scene's picture and depth to its surfaces and boxes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.geometry import cameras, regions, transforms

from .boxes import support_box
from .ends import BEHIND_M
from .fixtures import room_boxes, support_boxes, thing_boxes
from .front import front
from .hidden import continued
from .layers import Layers, grown
from .outline import broad, outline
from .patch import SUPPORT, Patch
from .patches import divide, nearest
from .pieces import atlas, one_picture
from .scenery import Scenery
from .shell import enclose, shell
from .slab import slab

if TYPE_CHECKING:
    from .static import StaticOptions

RIM = 0.006
"""Width of the support's rim beyond its outline, which is known to a few pixels, as a fraction of the picture's."""
FOOT_M = 0.03
"""A thing stands on the support if the lowest visible points of it are within this of its plane [m]."""


def bounded(layers: Layers, photograph: Photograph, support: Support) -> Layers:
    """The layers without support behind furniture that stands beyond its visible outline."""
    pose = support.camera_pose.matrix
    labels = np.where(layers.behind & ~layers.hole, SUPPORT, np.where(layers.elsewhere, SUPPORT + 1, 0))
    patch = Patch(SUPPORT, (pose[2, :3], float(pose[2, 3])))
    seen = Scenery(photograph.rgb.pixels, labels.astype(np.int32), [patch], photograph.camera.matrix(), pose)
    inside = regions.inside_convex(layers.floor, outline(seen, support.polygon, layers.hole))
    return replace(layers, behind=layers.behind & (~layers.hole | inside))


def survey(
    pixels: np.ndarray,
    depth: np.ndarray,
    behind: np.ndarray,
    taken: np.ndarray,
    beyond: np.ndarray,
    camera: Camera,
    support: Support,
    step_m: float,
) -> Scenery:
    """Divide the empty scene into surfaces.

    Args:
        pixels: (H, W, 3) uint8, without objects.
        depth: (H, W) [m]; 0 if unknown or removed.
        behind: (H, W) pixels of the support, visible or hidden by objects.
        taken: (H, W) removed pixels off the support that no photograph shows.
        beyond: (H, W) those at which the support goes on if nothing else does.
        camera: Intrinsics [px].
        support: Its plane.
        step_m: Surfaces farther apart in depth are not joined [m].
    """
    pose, k = support.camera_pose.matrix, camera.matrix()
    plane = pose[2, :3], float(pose[2, 3])
    labels, patches = divide(pixels, depth, k, broad(behind), plane, taken, beyond, step_m)
    return Scenery(pixels, labels, patches, k, pose)


def trimmed(scenery: Scenery, layers: Layers, support: Support) -> tuple[Scenery, np.ndarray]:
    """The scenery without a rim of filled support beyond its outline, and the rim's pixels (H, W).

    They go to a plane farther away next to them, because on it, the colours of the support would be a line.
    """
    inside = _inside(layers, outline(scenery, support.polygon, layers.hole))
    own = scenery.labels == SUPPORT
    reach = max(2, round(RIM * own.shape[1]))
    flat = np.isin(scenery.labels, [p.number for p in scenery.patches if p.plane is not None and p.number != SUPPORT])
    rim = own & ~inside & layers.hole & grown(own & inside, reach) & grown(flat, reach)
    if not rim.any():
        return scenery, rim
    wider = replace(scenery, labels=np.where(rim, nearest(scenery.labels, flat), scenery.labels))
    rim &= wider.depth > layers.plane + BEHIND_M
    return replace(scenery, labels=np.where(rim, wider.labels, scenery.labels)), rim


def _inside(layers: Layers, edge: np.ndarray) -> np.ndarray:
    """Pixels (H, W) whose ray meets the support inside its outline (P, 2), or where it goes on behind holes."""
    inside = np.isfinite(layers.plane) & regions.inside_convex(layers.floor, edge)
    return np.asarray(inside | (layers.beyond & ~layers.behind))


def seen_of(mask: np.ndarray, depth: np.ndarray, camera: Camera, support: Support) -> np.ndarray:
    """A sample of the points (N, 3) in a mask, in the world frame [m]."""
    return _sample(mask & (depth > 0), cameras.backproject(depth, camera.matrix()), support)


def feet_of(instances: np.ndarray, depth: np.ndarray, camera: Camera, support: Support) -> np.ndarray:
    """Points (F, 2) of the instances (H, W) that stand on the support's plane, projected onto it [m]."""
    found, measured = [np.zeros((0, 2))], cameras.backproject(depth, camera.matrix())
    for number in np.unique(instances[instances > 0]):
        points = _sample((instances == number) & (depth > 0), measured, support)
        if len(points) and abs(float(np.quantile(points[:, 2], 0.02))) < FOOT_M:
            found.append(points[:: max(1, len(points) // 300), :2])
    return np.concatenate(found)


def _sample(mask: np.ndarray, measured: np.ndarray, support: Support) -> np.ndarray:
    """Some of the points (H, W, 3) of a camera in a mask, in the world frame (N, 3) [m]."""
    points = measured[mask]
    return transforms.apply(support.camera_pose.matrix, points[:: max(1, len(points) // 3000)])


def furnished(
    scenery: Scenery,
    layers: Layers,
    support: Support,
    objects: np.ndarray,
    feet: np.ndarray,
    stride: float,
    common: StaticOptions,
) -> Background:
    """The surfaces and boxes of an empty scene.

    Args:
        scenery: The visible empty scene.
        layers: Intersections of the pixels' rays with the support's plane, and removed pixels.
        support: Its plane and measured outline.
        objects: (N, 3) points of removed objects, world frame [m].
        feet: (F, 2) points of those that stand on the support's plane, projected onto it [m].
        stride: Spacing of vertices [px].
        common: Thickness of the support and margin of its box.
    """
    edge = outline(scenery, support.polygon, layers.hole)
    box = support_box(edge, common.margin_m, common.thickness_m)
    inside = _inside(layers, edge)
    seen = scenery.points_of(SUPPORT)
    # Other pixels classified as support beyond its outline belong to the room, at any depth.
    scenery = replace(scenery, labels=np.where((scenery.labels == SUPPORT) & ~inside, 0, scenery.labels))
    room = enclose(scenery, edge, box.yaw)
    wider, behind = continued(scenery, room, stride)
    shown = one_picture(front(scenery, stride, inside, behind), scenery.pixels)
    vertices = shown.vertices.copy()
    vertices[np.abs(vertices[:, 2]) < 1e-5, 2] = 0.0
    made = [*wider, *slab(scenery, edge, common.thickness_m), *shell(room, scenery)]
    return Background(
        image=Image(pixels=scenery.pixels),
        depth=DepthImage(depth=scenery.depth.astype(np.float32)),
        mesh=shown.model_copy(update={"vertices": vertices}),
        invented=atlas(made),
        boxes=(
            box,
            *support_boxes(seen, feet, box, room),
            *room_boxes(room),
            *thing_boxes(scenery, room, objects, common.thickness_m),
        ),
    )
