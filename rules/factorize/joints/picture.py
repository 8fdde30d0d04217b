"""Draw the hinge on the photograph of an object."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.object import Body, Joint
from dextera_build.artifacts.view import Seen
from dextera_build.geometry import cameras, kinematics, transforms

_ENLARGED = 2


def draw(body: Body, seen: Seen) -> np.ndarray:
    """Draw the axis in red, the lid's far edge in white, and its edge at the limits in blue; (H, W, 3) uint8."""
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
