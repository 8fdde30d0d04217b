"""align.moved: what changed between the first and the last frame of a video: the camera and the objects."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.track import Track
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.artifacts.table import Column, Table
from dextera_build.geometry import poses, transforms
from dextera_build.rule import Context, Options, rule

_COLUMNS = (
    Column(name="what"),
    Column(name="moved", unit="mm", digits=1),
    Column(name="turned", unit="deg", digits=1),
    Column(name="state"),
)
_Row: TypeAlias = tuple[str, float | None, float | None, str]
"""Name, distance [mm], angle [deg] and state."""
_SIGMAS = 3.0
"""Standard deviations below which a motion is chance."""


class MovedOptions(Options):
    """Options of align.moved."""

    least_m: PositiveFloat = 0.005
    """Distance below which an object or the camera stayed [m]."""
    least_deg: PositiveFloat = 3.0
    """Angle below which an object stayed [deg]."""
    camera_deg: PositiveFloat = 0.2
    """Angle below which the camera stayed [deg]."""


@rule(version=1, packages=("numpy",))
def moved(
    ctx: Context, tracking: Tracking, support: Support, camera: Pose, *, options: MovedOptions | None = None
) -> Table:
    """Return one row for the camera and one per object: its motion in the world, and `moved`, `stayed` or `not found`.

    A motion within three standard deviations counts as none, so that the unknown angle of a round object does not turn
    it.

    Args:
        ctx: Context.
        tracking: Poses in the world.
        support: T_world_camera of the first frame.
        camera: T_world_camera of the last frame.
        options: Options.
    """
    options = options or MovedOptions()
    shift, angle = _motion(support.camera_pose.matrix, camera.matrix)
    still = shift < options.least_m and angle < options.camera_deg
    rows: list[_Row] = [("camera", 1000 * shift, angle, "stayed" if still else "moved")]
    rows += [(name, *_object(track, options)) for name, track in tracking.tracks.items()]
    ctx.metric("camera moved", 1000 * shift, "mm")
    ctx.metric("camera turned", angle, "deg")
    ctx.metric("moved", float(sum(row[3] == "moved" for row in rows[1:])), "objects")
    ctx.metric("not found", float(sum(row[3] == "not found" for row in rows[1:])), "objects")
    ctx.say(_sentence(rows))
    return Table(title="What moved since the twin's photograph", columns=_COLUMNS, rows=tuple(rows))


def _object(track: Track, options: MovedOptions) -> tuple[float | None, float | None, str]:
    if track.status[-1] == "lost":
        return None, None, "not found"
    first, last = poses.to_matrix(track.poses[0]), poses.to_matrix(track.poses[-1])
    shift, angle = _motion(first, last)
    spread = np.zeros((6, 6)) if track.covariances is None else track.covariances[0] + track.covariances[-1]
    far, wide = (float(np.sqrt(max(np.linalg.eigvalsh(part)[-1], 0.0))) for part in (spread[:3, :3], spread[3:, 3:]))
    went = shift > max(options.least_m, _SIGMAS * far)
    turned = angle > max(options.least_deg, _SIGMAS * np.degrees(wide))
    return 1000 * shift, angle, "moved" if went or turned else "stayed"


def _motion(old: np.ndarray, new: np.ndarray) -> tuple[float, float]:
    """Distance of the origins [m] and angle [deg] between two poses (4, 4)."""
    turn = new[:3, :3] @ old[:3, :3].T
    return float(np.linalg.norm(new[:3, 3] - old[:3, 3])), float(np.degrees(transforms.angle(turn)))


def _sentence(rows: list[_Row]) -> str:
    def told(name: str, far: float | None, angle: float | None, state: str) -> str:
        return f"{name} moved {far:.1f} mm, {angle:.1f} deg" if state == "moved" else f"{name} {state}"

    first, *things = rows
    changed = [told(*row) for row in things if row[3] != "stayed"]
    stayed = len(things) - len(changed)
    return "; ".join([told(*first), *changed, f"{stayed} of {len(things)} objects stayed"])
