"""The support of a photograph without depth: from a marker on it, from the robot that stands on it, or assumed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import ScaleSource, Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, lie, regions, transforms, upright
from dextera_build.rule import Context, Options


class MarkerOptions(Options):
    """A printed ArUco marker that lies flat on the support."""

    size_m: PositiveFloat
    """Edge length of its black square [m]."""
    number: NonNegativeInt = 0
    """Its number in the dictionary."""
    dictionary: str = "DICT_4X4_50"
    """Name of the dictionary in OpenCV."""


CORNER_PX = 0.3
"""Standard deviation of the corners of a marker [px]."""
PITCH_DEG = 35.0
"""Pitch of a camera of which nothing is known [deg]."""
LINES_RAD = np.radians(3.0)
"""Standard deviation of the direction by upright lines [rad]; see `uprights`."""
GRAVITY_RAD = np.radians(1.0)
"""Standard deviation of the direction by an inertial sensor at rest [rad]."""
PITCH_RAD, STATED_RAD, ROLL_RAD = np.radians(10.0), np.radians(4.0), np.radians(3.0)
"""Standard deviations of an assumed pitch, of a stated one, and of the roll of both [rad]."""


class Plane(NamedTuple):
    """A support in the camera frame."""

    normal: np.ndarray  # (3,) unit, up
    height: float  # of the camera above it
    scale: ScaleSource
    others: tuple[tuple[np.ndarray, float], ...] = ()
    """Normal and height one standard deviation away, in each independent direction."""
    source: str = ""
    """What told the normal, where the scale is unknown."""


def marked(ctx: Context, photograph: Photograph, marker: MarkerOptions) -> Plane:
    """The plane of a marker [m], by the pose of a square (Collins and Bartoli: IPPE, IJCV 2014)."""
    import cv2

    known = getattr(cv2.aruco, marker.dictionary, None)
    if not marker.dictionary.startswith("DICT_") or known is None:
        names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
        ctx.fail(f"no dictionary of markers is called `{marker.dictionary}`", exist=", ".join(names))
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(known), cv2.aruco.DetectorParameters())
    grey = cv2.cvtColor(photograph.rgb.pixels, cv2.COLOR_RGB2GRAY)
    corners, numbers, _ = detector.detectMarkers(grey)
    seen = [] if numbers is None else [int(n) for n in np.ravel(numbers)]
    if seen.count(marker.number) != 1:
        ctx.fail(
            f"marker {marker.number} of {marker.dictionary} is seen {seen.count(marker.number)} times",
            seen=", ".join(map(str, sorted(seen))) or "none",
            hint="lay one marker flat on the support, whole and with a white border, or leave out `marker`",
        )
    half = marker.size_m / 2.0
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    pixels = np.asarray(corners[seen.index(marker.number)], np.float64).reshape(4, 1, 2)
    k = photograph.camera.matrix()

    def plane(corners: np.ndarray) -> tuple[np.ndarray, float, float]:
        _, turns, shifts, errors = cv2.solvePnPGeneric(square, corners, k, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        best = int(np.argmin(np.ravel(errors)))
        normal = cv2.Rodrigues(turns[best])[0][:, 2]
        return normal, -float(normal @ shifts[best].ravel()), float(np.ravel(errors)[best])

    normal, height, error = plane(pixels)
    ctx.metric("marker residual", error, "px")
    moved = CORNER_PX * np.eye(8).reshape(8, 4, 1, 2)
    return Plane(normal, height, "marker", tuple(plane(pixels + shift)[:2] for shift in moved))


def under_robot(robot: Pose, base_above_m: float) -> Plane:
    """The plane that the robot stands on [m]: across its base's z axis.

    Args:
        robot: T_camera_base.
        base_above_m: Height of the base's origin above the support [m].
    """
    normal = robot.matrix[:3, 2]
    return Plane(normal, base_above_m - float(normal @ robot.matrix[:3, 3]), "robot")


def looking_down(pitch_deg: float, turns: int, source: str, sigma: float) -> Plane:
    """A level support one unit below a camera that looks down by `pitch_deg` [deg]; the unit is unknown.

    The picture is upright after `turns` counter-clockwise quarter turns; `sigma` is of the pitch [rad].
    """
    pitch = np.radians(pitch_deg)
    level = upright.turned_from_camera(-turns)[:3, :3]

    def normal(pitch: float, roll: float = 0.0) -> np.ndarray:
        return np.asarray(
            level @ np.array([np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll), -np.sin(pitch)])
        )

    others = (normal(pitch + sigma), 1.0), (normal(pitch, ROLL_RAD), 1.0)
    return Plane(normal(pitch), 1.0, "unknown", others, source)


def level(up: np.ndarray, source: str, sigma: float) -> Plane:
    """A support one unit below the camera, of an unknown unit, across the direction up (3,) in the camera frame.

    `sigma` is the standard deviation of the direction about each axis [rad].
    """
    sideways = np.cross(up, [0.0, 0.0, 1.0])
    axes = [each / np.linalg.norm(each) for each in (sideways, np.cross(up, sideways))]
    others = tuple((lie.rotation(sigma * axis) @ up, 1.0) for axis in axes)
    return Plane(up, 1.0, "unknown", others, source)


def support(ctx: Context, photograph: Photograph, plane: Plane, reach: float, turns: int) -> Support:
    """The world frame on a plane; its outline is the part that the camera sees, up to `reach` heights of the camera.

    World x is the image right of the picture after `turns` counter-clockwise quarter turns.
    """
    if plane.height <= 0:
        ctx.fail(
            "the camera is below the support", scale=plane.scale, hint="check the pose that the support comes from"
        )
    image_right = upright.turned_from_camera(-turns)[:3, 0]
    axes = _axes(plane.normal, image_right)
    lens = photograph.camera
    thin = max(1, lens.height // 90)
    rays = cameras.rays(lens.height, lens.width, lens.matrix())[::thin, ::thin]
    world = rays.reshape(-1, 3) @ axes.T
    world = world[world[:, 2] < -1e-6]
    ground = world[:, :2] * (plane.height / -world[:, 2:])
    ground = ground[np.linalg.norm(ground, axis=1) <= reach * plane.height]
    if len(ground) < 3:
        ctx.fail("nothing of the support is in view", hint="raise `reach`, or check `pitch_deg`")
    outline = regions.convex_hull(ground)
    middle = regions.centroid(outline)

    def pose(axes: np.ndarray, height: float) -> np.ndarray:
        return transforms.rigid(axes, np.array([-middle[0], -middle[1], height]))

    found = pose(axes, plane.height)
    steps = [lie.between(found, pose(_axes(normal, image_right), height)) for normal, height in plane.others]
    covariance = sum(np.outer(step, step) for step in steps) if steps else None
    return Support(
        camera_pose=Pose(parent="world", child="camera", matrix=found, covariance=covariance),
        polygon=np.ascontiguousarray(outline - middle),
        scale=plane.scale,
    )


def _axes(normal: np.ndarray, image_right: np.ndarray) -> np.ndarray:
    """Rows (3, 3): the world's x, y and z in the camera frame."""
    up = normal / np.linalg.norm(normal)
    right = image_right - (image_right @ up) * up
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(up, right), up])
