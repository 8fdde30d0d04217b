"""What a policy needs of the cameras of a robot, and frames of the messages that they sent."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.deploying.frozen import Frozen
from dextera_build.deploying.stream import Sample, Stream
from dextera_build.deploying.topics import Topics
from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import images
from dextera_build.formats.ros.reading import SECOND
from dextera_build.geometry import cameras
from dextera_build.policy.cameras import TERMS, camera_of, term_of
from dextera_build.policy.observation import Frame

TOGETHER_NS = SECOND // 50
"""Largest difference of the stamps of a picture and its depth [ns], which drivers that register depth make equal."""
KEPT_S = 1.0
"""Time for which pictures are kept [s], because the depth of one and the picture of another camera come later."""

Shown = Mapping[tuple[str, str], Sample]
"""Term and camera -> its message."""


class NeededCameras:
    """The cameras of a policy.

    Args:
        topics: Topics of all cameras of the robot.
        needed: Channels that the policy takes; of several cameras `rgb/front`, else `rgb` is of all.
        lenses: Camera -> intrinsics, for points.
        silence_s: Time for which a camera may repeat a picture while the robot moves [s].
        skew_s: Allowed difference of the stamps of several cameras [s].
    """

    def __init__(
        self,
        topics: Topics,
        needed: Collection[str],
        lenses: Mapping[str, Camera],
        silence_s: float,
        skew_s: float,
    ) -> None:
        self._skew = round(skew_s * SECOND)
        self._topics, self._lenses, self._rays = topics, lenses, dict[str, np.ndarray]()
        self.channels = {(term, name) for each in needed for term, name in _looks(each, topics.pictures)}
        """Terms with the cameras that they are needed of."""
        self.pictures = {camera: _stream(topic) for camera, topic in topics.pictures.items()}
        self.depths = {camera: _stream(topic) for camera, topic in topics.depths.items()}
        every = (("rgb", self.pictures), ("depth", self.depths))
        found = {(term, name): each for term, streams in every for name, each in streams.items()}
        self.streams = {key: each for key, each in found.items() if key in self.channels}
        """Term and camera -> stream of what the policy needs."""
        self._frozen = {key: Frozen(silence_s) for key in found}

    def watch(self, term: str, camera: str, picture: bytes, arrived: int, joints: np.ndarray | None) -> None:
        """Note a fault of a camera that shows the same while the robot moves, see `Frozen.add`."""
        stream = self.pictures[camera] if term == "rgb" else self.depths[camera]
        if self._frozen[term, camera].add(picture, arrived, joints):
            stream.fault = stream.fault or f"`{camera}` shows the same picture while the robot moves"

    def apart(self) -> str:
        """The topics of a camera whose picture and depth are of no common time; empty if there is none."""
        names = dict.fromkeys(camera for _, camera in self.streams)
        return next((self._both(camera) for camera in names if not any(self._whole(camera))), "")

    def shown(self) -> Shown:
        """The newest messages that belong together: picture and depth of one time, and cameras of nearly one.

        A camera of which `apart` tells has none.
        """
        whole = [found for name in dict.fromkeys(name for _, name in self.streams) if (found := [*self._whole(name)])]
        together: list[Shown] = []
        for anchor in sorted((_stamp(each) for frames in whole for each in frames), reverse=True):
            together = [min(frames, key=lambda each: abs(_stamp(each) - anchor)) for frames in whole]
            stamps = [_stamp(each) for each in together]
            # Of two cameras each may have lost another frame.
            if max(stamps) - min(stamps) <= self._skew:
                break
        return {key: sample for each in together for key, sample in each.items()}

    def frame(self, camera: str, shown: Shown) -> Frame:
        """The frame of a camera by the messages of each term and camera."""
        picture, measured = shown.get(("rgb", camera)), shown.get(("depth", camera))
        rgb = None if picture is None else images.pixels(picture.value, self._topics.pictures[camera].name)
        depth = None if measured is None else images.depths(measured.value, self._topics.depths[camera].name)
        return Frame(rgb, depth, None if depth is None else self._cloud(camera, depth))

    def _both(self, camera: str) -> str:
        return f"{self.pictures[camera].name} with {self.depths[camera].name} of the same time"

    def _whole(self, camera: str) -> Iterator[Shown]:
        """What a camera showed at one time, oldest first, as far as all of it has arrived."""
        (first, *others) = [key for key in self.streams if key[1] == camera]
        for sample in self.streams[first].samples():
            found = {key: self.streams[key].nearest(sample.stamp) for key in others}
            near = {key: each for key, each in found.items() if each and abs(each.stamp - sample.stamp) <= TOGETHER_NS}
            if len(near) == len(others):
                yield {first: sample, **near}

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


def _stream(topic: Topic) -> Stream:
    return Stream(topic.name, KEPT_S, steady=False)


def _stamp(shown: Shown) -> int:
    """When the oldest of some messages was made [ns]."""
    return min(each.stamp for each in shown.values())


def _looks(channel: str, known: Collection[str]) -> list[tuple[str, str]]:
    """Terms and cameras that a channel needs: points need depth, and without a name it is of all cameras."""
    term = term_of(channel)
    if term not in TERMS:
        return []
    names = [camera_of(channel)] if channel != term else [*known]
    return [(each, name) for name in names for each in ((term, "depth") if term == "cloud" else (term,))]
