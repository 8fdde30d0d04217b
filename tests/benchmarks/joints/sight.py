"""What an RGB-D camera with the project's noise sees of a jointed thing on a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.view import Instance, MeasuredView, ObjectView, Traits
from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.geometry import cameras, kinematics, raycast, transforms
from dextera_build.sim.render.sensor import measure_depth
from tests import factories

from .kinds import Thing

LENS = Camera(width=640, height=480, fx=610.0, fy=610.0, cx=319.5, cy=239.5)
TABLE = raycast.Surface(
    np.array([[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
    colour=(0.5, 0.4, 0.3),
)
NOISE = DepthNoise()
GRAZING = np.cos(np.radians(NOISE.grazing_deg - 10.0))
"""Cosine between ray and normal from which depth is surely measured."""


@dataclass(frozen=True)
class Stand:
    """Where a thing stands and from where it is seen."""

    pose: np.ndarray  # (4, 4) T_world_object
    eye: np.ndarray  # (4, 4) T_world_camera


def stand(thing: Thing, draw: np.random.Generator, heading: float, pitch: float) -> Stand:
    """A thing near the world's origin, and a camera that looks at it so that it fills most of the picture.

    Args:
        thing: The thing.
        draw: Draws place and turn on the table.
        heading: Side from which it is seen, 0 from its front (-y) [rad].
        pitch: Angle of the line of sight below the horizon [rad].
    """
    corners = np.concatenate([solid.vertices for solid in thing.posed().values()])
    yaw = draw.uniform(0, 2 * np.pi)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    pose = transforms.rigid(turn, np.array([*draw.uniform(-0.05, 0.05, 2), 0.0]))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    distance = max(0.35, 1.35 * float(np.linalg.norm(np.ptp(corners, axis=0))))
    target = transforms.apply(pose, middle)
    return Stand(pose, cameras.look_down(target, distance, heading - yaw, pitch, 0.0))


def look(thing: Thing, place: Stand, seed: int) -> Instance:
    """A noisy view of the thing alone on its table; the mask is the true one."""
    posed = thing.posed()
    parts = [raycast.posed(posed[name].vertices, posed[name].faces, place.pose) for name in sorted(posed)]
    seen = raycast.render([*parts, TABLE], LENS.matrix(), place.eye, LENS.height, LENS.width)
    rgb = raycast.shade([*parts, TABLE], seen)
    depth = measure_depth(seen.depth, rgb / 255.0, LENS.matrix(), NOISE, np.random.default_rng(seed))
    mask = (seen.index >= 0) & (seen.index < len(parts))
    return Instance(
        view=ObjectView(
            rgb=Image(pixels=rgb), mask=mask, occluder=np.zeros(mask.shape, bool), camera=LENS, phrase="thing"
        ),
        traits=Traits(category="object", body_type="articulated", material="plastic"),
        measured=MeasuredView(depth=DepthImage(depth=depth), camera_pose=factories.placed(place.eye, "camera")),
    )


def shared(first: Thing, second: Thing, before: Stand, after: Stand) -> float:
    """Least part of a moving link's surface, as seen in the first state, that is measured in the second one, too."""
    posed, again = first.posed(), second.posed()
    names = sorted(posed)
    one, two = (
        raycast.render(
            [*(raycast.posed(solids[name].vertices, solids[name].faces, place.pose) for name in names), TABLE],
            LENS.matrix(),
            place.eye,
            LENS.height,
            LENS.width,
        )
        for solids, place in ((posed, before), (again, after))
    )
    poses, later = kinematics.link_poses(first), kinematics.link_poses(second)
    shares = []
    for joint in first.joints:
        mine = one.index == names.index(joint.child)
        if not mine.any():
            return 0.0
        points = transforms.apply(before.eye, cameras.backproject(one.depth, LENS.matrix()))[mine]
        motion = after.pose @ later[joint.child] @ transforms.invert(before.pose @ poses[joint.child])
        local = transforms.apply(transforms.invert(after.eye), transforms.apply(motion, points))
        rows, columns, inside = cameras.nearest_pixels(local, LENS.matrix(), two.depth.shape)
        there = (two.index[rows, columns] == names.index(joint.child)) & (
            np.abs(two.depth[rows, columns] - local[:, 2]) < 0.004
        )
        facing = np.minimum(_cosines(one, before)[mine], _cosines(two, after)[rows, columns])
        shares.append(float((inside & there & (facing > GRAZING)).mean()))
    return min(shares)


def _cosines(render: raycast.Render, place: Stand) -> np.ndarray:
    """Cosine (H, W) between rays and normals."""
    rays = cameras.rays(LENS.height, LENS.width, LENS.matrix()) @ place.eye[:3, :3].T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.abs((rays * render.normal).sum(axis=-1))
