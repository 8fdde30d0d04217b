"""Draw the joints on the photograph of an object, and the object with its joints from closed to open."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Body, Joint
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, kinematics, transforms
from dextera_build.geometry.thumbnail import Paint, thumbnail

_ENLARGED = 2
_FRAMES = 5
"""Number of positions of a joint, from its lower to its upper limit."""


def draw(body: Body, seen: Seen) -> np.ndarray:
    """Draw the axis in red, the lid's far edge in white, and the edge at the limits in blue; (H, W, 3) uint8."""
    from PIL import Image, ImageDraw

    assert body.pose is not None
    rows, columns = seen.rgb.shape[:2]
    picture = Image.fromarray(seen.rgb).resize((columns * _ENLARGED, rows * _ENLARGED))
    pen = ImageDraw.Draw(picture)
    camera_from_object = (seen.measured.camera_pose.inverse() @ body.pose).matrix
    for joint in body.joints:
        axis, tip = _lines(body, joint)
        pen.line(_pixels(axis, camera_from_object, seen), fill=(230, 40, 40), width=3)
        arc = [_moved(tip[:1], joint, angle)[0] for angle in np.linspace(joint.lower, joint.upper, 24)]
        pen.line(_pixels(np.array(arc), camera_from_object, seen), fill=(60, 130, 246), width=2)
        for angle, colour in (
            (joint.lower, (60, 130, 246)),
            (joint.upper, (60, 130, 246)),
            (joint.position, (255,) * 3),
        ):
            pen.line(_pixels(_moved(tip, joint, angle), camera_from_object, seen), fill=colour, width=2)
    return np.asarray(picture)


def strip(body: Body) -> np.ndarray:
    """One row per joint with the object from the lower to the upper limit, other joints as photographed; uint8 RGB."""
    rows = [
        [_posed(body, joint, value) for value in np.linspace(joint.lower, joint.upper, _FRAMES)]
        for joint in body.joints
    ]
    around = np.concatenate([corners.reshape(-1, 3) for row in rows for parts in row for corners, _ in parts])
    return np.concatenate([np.concatenate([thumbnail(parts, around) for parts in row], axis=1) for row in rows])


def _posed(body: Body, joint: Joint, value: float) -> list[tuple[np.ndarray, Paint]]:
    """Corners of all faces with one joint at another position, and the colours of the faces."""
    poses = kinematics.link_poses(body, {joint.name: value})
    links = ((poses[name], link.mesh) for name, link in body.links.items())
    return [(transforms.apply(pose, mesh.vertices)[mesh.faces], mesh.paint) for pose, mesh in links]


def _lines(body: Body, joint: Joint) -> tuple[np.ndarray, np.ndarray]:
    """The axis segment along the moving link, and that link's farthest edge, (2, 3) each [m]."""
    vertices = body.links[joint.child].mesh.vertices.astype(np.float64)
    origin, axis = np.array(joint.origin), np.array(joint.axis)
    along = (vertices - origin) @ axis
    ends = origin + np.outer([along.min(), along.max()], axis)
    radial = vertices - origin - np.outer(along, axis)
    return ends, ends + radial[int(np.argmax(np.linalg.norm(radial, axis=1)))]


def _moved(points: np.ndarray, joint: Joint, angle: float) -> np.ndarray:
    return transforms.apply(kinematics.joint_motion(joint, angle), points)


def _pixels(points: np.ndarray, camera_from_object: np.ndarray, seen: Seen) -> list[tuple[float, float]]:
    local = transforms.apply(camera_from_object, points)
    local = local[local[:, 2] > 0.01]
    return [(float(x) * _ENLARGED, float(y) * _ENLARGED) for x, y in cameras.project(local, seen.camera.matrix())]
