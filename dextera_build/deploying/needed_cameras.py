"""What a policy needs of the cameras of a robot, and frames of the messages that they sent."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.deploying.stream import Sample
from dextera_build.deploying.topics import Topics
from dextera_build.formats.ros import images
from dextera_build.geometry import cameras
from dextera_build.policy.cameras import TERMS, camera_of, term_of
from dextera_build.policy.observation import Frame


class NeededCameras:
    """The cameras of a policy.

    Args:
        topics: Topics of all cameras of the robot.
        needed: Channels that the policy takes; of several cameras `rgb/front`, else `rgb` is of all.
        lenses: Camera -> intrinsics, for points.
    """

    def __init__(self, topics: Topics, needed: Collection[str], lenses: Mapping[str, Camera]) -> None:
        self._topics, self._lenses, self._rays = topics, lenses, dict[str, np.ndarray]()
        self.channels = {(term, name) for each in needed for term, name in _looks(each, topics.pictures)}
        """Terms with the cameras that they are needed of."""

    def frame(self, camera: str, shown: Mapping[tuple[str, str], Sample | None]) -> Frame:
        """The frame of a camera by the last message of each term and camera."""
        picture, measured = shown.get(("rgb", camera)), shown.get(("depth", camera))
        rgb = None if picture is None else images.pixels(picture.value, self._topics.pictures[camera].name)
        depth = None if measured is None else images.depths(measured.value, self._topics.depths[camera].name)
        return Frame(rgb, depth, None if depth is None else self._cloud(camera, depth))

    def _cloud(self, camera: str, depth: np.ndarray) -> np.ndarray | None:
        """Points (H, W, 3) of a depth picture, if the policy takes them."""
        lens = self._lenses.get(camera)
        if lens is None or ("cloud", camera) not in self.channels:
            return None
        rays = self._rays.get(camera)
        if rays is None or rays.shape[:2] != depth.shape:
            rays = cameras.rays(depth.shape[0], depth.shape[1], lens.matrix()).astype(np.float32)
            self._rays[camera] = rays
        return np.asarray(depth[..., None] * rays)


def _looks(channel: str, known: Collection[str]) -> list[tuple[str, str]]:
    """Terms and cameras that a channel needs: points need depth, and without a name it is of all cameras."""
    term = term_of(channel)
    if term not in TERMS:
        return []
    names = [camera_of(channel)] if channel != term else [*known]
    return [(each, name) for name in names for each in ((term, "depth") if term == "cloud" else (term,))]
