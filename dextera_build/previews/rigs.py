"""Cameras with poses: calibrations, rigs, views."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry.plot import COLOURS, Line, plot
from dextera_build.previews.images import beside_plot


def _facts_of_calibration(found: Calibration) -> Iterator[str]:
    """Mount, frames, method, uncertainty and residuals."""
    yield found.mount
    yield f"T_{found.pose.parent}_{found.pose.child}"
    if found.method:
        yield found.method
    sigma = found.pose.sigma()
    if sigma is not None:
        yield f"sigma {1000 * sigma[0]:.2g} mm, {np.degrees(sigma[1]):.2g} deg"
    if found.residuals is not None and len(found.residuals):
        distance, angle = np.sqrt((found.residuals**2).mean(axis=0))
        yield f"{len(found.residuals)} observations"
        yield f"residuals {1000 * distance:.2g} mm, {np.degrees(angle):.2g} deg RMS"


def residuals(found: Calibration) -> np.ndarray:
    """Residuals in blue and leave-one-out changes in orange, per observation: [mm] left, [deg] right; (H, W, 3)."""
    drawn = [(found.residuals, COLOURS[0]), (found.leave_one_out, COLOURS[1])]
    sides = []
    for column, scale, unit in ((0, 1000.0, "[mm]"), (1, 180 / np.pi, "[deg]")):
        lines = [Line(np.zeros((1, 2)), (255, 255, 255), dots=True)]  # both axes begin at 0
        for series, colour in drawn:
            if series is not None:
                values = np.stack([np.arange(1, len(series) + 1), scale * series[:, column]], axis=1)
                lines.append(Line(values, colour, dots=True))
        sides.append(plot(lines, "observation", unit))
    return np.hstack(sides)


def _picture_of_calibration(found: Calibration) -> bytes:
    return png(residuals(found))


def _facts_of_rig(rig: Rig) -> Iterator[str]:
    """Number of cameras, and the longest distance between two."""
    yield f"{len(rig.cameras)} cameras ({', '.join(sorted(rig.cameras))})"
    places = np.array([pose.matrix[:3, 3] for pose in rig.poses.values()]).reshape(-1, 3)
    if len(places) > 1:
        far = np.linalg.norm(places[:, None] - places[None], axis=-1).max()
        yield f"at most {1000 * far:.0f} mm apart"


def _picture_of_rig(rig: Rig) -> bytes:
    """The cameras in the plane of x and z of the rig, each with its viewing direction."""
    matrices = [rig.poses[label].matrix for label in sorted(rig.poses)]
    places = np.array([matrix[[0, 2], 3] for matrix in matrices]).reshape(-1, 2)
    ahead = np.array([matrix[[0, 2], 2] for matrix in matrices]).reshape(-1, 2)
    return png(plot(_cameras(places, ahead, 0.4), "x [m]", "z [m]", equal=True))


def _cameras(places: np.ndarray, ahead: np.ndarray, reach: float) -> list[Line]:
    """Positions (N, 2) as dots and viewing directions (N, 2) as lines, as long as `reach` times their extent."""
    length = reach * float(np.ptp(places, axis=0).max(initial=0)) or 0.1
    rays = [Line(np.stack([place, place + length * way])) for place, way in zip(places, ahead, strict=True)]
    return [*rays, Line(places, COLOURS[1], dots=True)]


def _facts_of_views(views: Views) -> Iterator[str]:
    """Number of pictures, cameras and points, and the extent of the cameras' positions."""
    yield f"{len(views.names):,} pictures"
    yield f"{len(views.cameras)} cameras" if len(views.cameras) != 1 else "1 camera"
    if len(views.poses):
        yield " x ".join(f"{length:.2f}" for length in np.ptp(views.poses[:, :3, 3], axis=0)) + " m"
    if views.points is not None:
        yield f"{len(views.points.points):,} points"


def _picture_of_views(views: Views) -> bytes:
    """The cameras from above (along -z of their frame), each with its viewing direction, and the first picture."""
    places, ahead = views.poses[:, :2, 3], views.poses[:, :2, 2]
    map_of = plot(_cameras(places, ahead, 0.15), "x [m]", "y [m]", equal=True)
    if not views.names:
        return png(map_of)
    return png(np.hstack([map_of, beside_plot(views.pixels(views.names[0]))]))


def _facts_of_robot_views(views: RobotViews) -> Iterator[str]:
    """Number of pictures, mount, joints, depth and skew."""
    yield f"{len(views.captures)} pictures"
    yield views.mount
    if views.joints is not None:
        yield f"{len(views.joints.names)} joints"
    measured = sum(each.measured is not None for each in views.captures.values())
    yield f"depth on {measured}" if measured else "no depth"
    if views.skew_s is not None:
        yield f"skew up to {1000 * float(views.skew_s.max()):.0f} ms"


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    Calibration: _facts_of_calibration,
    Rig: _facts_of_rig,
    Views: _facts_of_views,
    RobotViews: _facts_of_robot_views,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    Calibration: _picture_of_calibration,
    Rig: _picture_of_rig,
    Views: _picture_of_views,
}
