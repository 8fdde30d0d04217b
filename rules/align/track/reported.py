"""Conversion of tracker results to tracks in the world or in the frame of the camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.track import Track
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.geometry import poses
from dextera_build.tracking.tracked_object import Tracked


def reported(
    video: RgbdVideo, assets: Mapping[str, Asset], rows: Sequence[Mapping[str, Tracked]], cameras: np.ndarray | None
) -> Tracking:
    """Tracks and joint positions of all objects.

    Args:
        video: The frames.
        assets: Name -> asset.
        rows: Results of each frame.
        cameras: T_world_camera (N, 4, 4); None for poses in the frame of the camera.
    """
    tracks = {name: _track(video, name, [row[name] for row in rows], cameras) for name in assets}
    joints = {
        name: Joints(
            names=tuple(joint.name for joint in asset.body.joints),
            stamps=video.stamps,
            positions=np.array([row[name].joints for row in rows], np.float64),
        )
        for name, asset in assets.items()
        if asset.body.joints
    }
    return Tracking(tracks=tracks, joints=joints)


def _track(video: RgbdVideo, name: str, found: Sequence[Tracked], cameras: np.ndarray | None) -> Track:
    placed, spread = np.full((len(found), 7), np.nan), np.zeros((len(found), 6, 6))
    parent = "camera" if cameras is None else "world"
    for number, each in enumerate(found):
        if each.pose is None or each.covariance is None:
            continue
        now = Pose(parent="camera", child=name, matrix=each.pose, covariance=each.covariance)
        if cameras is not None:
            now = Pose(parent="world", child="camera", matrix=cameras[number]) @ now
        assert now.covariance is not None
        placed[number], spread[number] = poses.from_matrix(now.matrix), now.covariance
    return Track(
        parent=parent,
        child=name,
        stamps=video.stamps,
        poses=placed,
        status=tuple(each.status for each in found),
        covariances=spread,
    )
