"""Poses, and poses over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_args

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.scenes.scene_fit import AlignedScene, SceneFit
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.artifacts.spatial.track import Status, Track
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.geometry.plot import COLOURS, Line, plot


def _facts_of_pose(motion: Pose) -> Iterator[str]:
    """Frames and position, and the angle."""
    yield from _facts(motion)


def _facts_of_similarity(motion: Similarity) -> Iterator[str]:
    """Frames and position, the angle and the scale."""
    yield from _facts(motion)
    yield f"scale {motion.scale:.4g}"


def _facts_of_trajectory(path: Trajectory) -> Iterator[str]:
    """Frames, number of poses, duration and length."""
    yield f"T_{path.parent}_{path.child}"
    yield f"{len(path.stamps):,} poses"
    yield f"{path.stamps[-1] - path.stamps[0]:.2f} s"
    yield f"{path.length_m():.3f} m"


def _picture_of_trajectory(path: Trajectory) -> bytes:
    """The path from above; its first pose is the green dot, its last the orange one."""
    places = path.poses[:, :2]
    ends = [Line(places[:1], COLOURS[2], dots=True), Line(places[-1:], COLOURS[1], dots=True)]
    return png(plot([Line(places), *ends], "x [m]", "y [m]", equal=True))


def _facts_of_track(track: Track) -> Iterator[str]:
    """Frames, number of poses, and how many of each status."""
    yield f"T_{track.parent}_{track.child}"
    yield f"{len(track.stamps):,} stamps"
    yield f"{track.stamps[-1] - track.stamps[0]:.2f} s"
    yield from (f"{track.status.count(kind):,} {kind}" for kind in get_args(Status) if kind in track.status)


def _picture_of_track(track: Track) -> bytes:
    """x, y and z over time in blue, orange and green; gaps where it was lost."""
    lines = [Line(np.stack([track.stamps, track.poses[:, axis]], axis=1), COLOURS[axis]) for axis in range(3)]
    return png(plot(lines, "t [s]", "[m]"))


def _facts_of_tracking(tracking: Tracking) -> Iterator[str]:
    """Frame, number of times, and number of times that each object was tracked."""
    first = next(iter(tracking.tracks.values()))
    yield f"in {first.parent}"
    yield f"{len(first.stamps):,} stamps"
    for name, track in tracking.tracks.items():
        yield f"{name} tracked in {track.status.count('tracked'):,}"


def _facts_of_scene_fit(fit: SceneFit) -> Iterator[str]:
    """Scale, standard deviations, evidence, doubts."""
    yield f"scale {fit.motion.scale:.4g}"
    if fit.motion.covariance is not None:
        spread = np.sqrt(np.diag(fit.motion.covariance))
        yield f"{1000 * np.linalg.norm(spread[:3]):.1f} mm, {np.degrees(np.linalg.norm(spread[3:6])):.2f} deg"
    yield f"{fit.evidence.inliers} of {fit.evidence.pairs} pairs"
    yield from fit.doubts


def _facts_of_aligned_scene(scene: AlignedScene) -> Iterator[str]:
    """Frame and sizes."""
    yield f"frame {scene.frame}"
    if scene.splats is not None:
        yield f"{len(scene.splats.means):,} Gaussians"
    if scene.mesh is not None:
        yield f"{len(scene.mesh.faces):,} triangles"


def _facts(motion: Pose | Similarity) -> Iterator[str]:
    place = ", ".join(f"{length + 0.0:.3f}" for length in np.round(motion.matrix[:3, 3], 3))
    cosine = (np.trace(motion.matrix[:3, :3]) - 1) / 2
    yield f"T_{motion.parent}_{motion.child} at ({place}) m"
    yield f"turned {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.1f} deg"


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    Pose: _facts_of_pose,
    Similarity: _facts_of_similarity,
    Trajectory: _facts_of_trajectory,
    Track: _facts_of_track,
    Tracking: _facts_of_tracking,
    SceneFit: _facts_of_scene_fit,
    AlignedScene: _facts_of_aligned_scene,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    Trajectory: _picture_of_trajectory,
    Track: _picture_of_track,
}
