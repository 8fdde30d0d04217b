"""demonstrate.mcap with ROS 2 messages in CDR."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats.h264 import Encoder
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import LATCHED, Recording, packed
from dextera_build.geometry import poses
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.layout import of_episodes
from dextera_build.policy.terms import Term
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe.shapes import Shapes

from .mcap_place import place

if TYPE_CHECKING:
    from .cameras import Camera
    from .mcap import McapOptions

BACKEND = Backend(
    summary="ROS 2 messages in CDR, schemas as ros2msg",
    profiles=("cpu",),
    packages=("av", "mcap", "mujoco", "zstandard"),
    extra="learn",
)
BASE = "base"
"""The robot's base frame."""


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: McapOptions,
    options: Options,
) -> None:
    """Write each recording below `out`."""
    shapes = Shapes(bundle)
    if shapes.clashes:
        ctx.fail("an object has the name of a link of the robot", names=", ".join(sorted(shapes.clashes)))
    if common.shapes == "beside":
        with (out / "scene.mcap").open("wb") as file:
            beside = Recording(file, common.compression)
            shapes.send(beside, 0, {})
            beside.finish()
    for number, (label, episode) in enumerate(episodes.in_order()):
        pictures = [_Pictures(each, label, episodes, common) for each in seen]
        with (out / f"episode-{number:06d}.mcap").open("wb") as file:
            recording = EpisodeRecording(file, episodes, common, shapes)
            recording.describe(bundle, label, episode)
            recording.once(bundle, seen, episode)
            for step in range(len(episode.joints)):
                recording.step(episode, step)
                for each in pictures:
                    recording.pictures(step, each)
            recording.close()
        ctx.progress(number + 1, len(episodes.items), "recordings")


def _optical(camera: Camera) -> str:
    """The frame of a camera."""
    return f"{camera.name}_color_optical_frame"


class _Pictures:
    """What a camera saw in one episode, step by step."""

    def __init__(self, camera: Camera, label: str, episodes: Episodes, options: McapOptions) -> None:
        self.camera, film = camera, camera.film
        self.colours = iter(()) if film is None else _encoded(film, label, episodes, options)
        self.depths = iter(()) if film is None or not camera.has_depth else film.each_depth(label)


def _encoded(film: Film, label: str, episodes: Episodes, options: McapOptions) -> Iterator[bytes]:
    """The frames of an episode, one at a time."""
    if options.picture != "h264":
        return (packed(pixels, options.picture, options.quality) for pixels in film.each(label))
    rate = Fraction(episodes.rate_hz).limit_denominator(1001)
    return Encoder(film.width, film.height, rate, options.qp, options.keyframe_every).stream(film.each(label))


class EpisodeRecording:
    """One MCAP file.

    Args:
        file: Where to write.
        episodes: Names and rate of the recorded channels.
        options: Name of the camera, image encoding, compression.
        shapes: Links and shapes of the task.
    """

    def __init__(self, file: BinaryIO, episodes: Episodes, options: McapOptions, shapes: Shapes) -> None:
        self._episodes, self._options, self._shapes = episodes, options, shapes
        self._out = Recording(file, options.compression)
        # The goal is in `task.json`, so its names are not needed.
        self._terms = [term for term in of_episodes(episodes, ()).terms() if term.declared.topic]

    def describe(self, bundle: TaskBundle, label: str, episode: Episode) -> None:
        """Write the task, the outcome, and the start from which the episode can be rerun."""
        begin = episode.start
        facts = {
            "task": bundle.task.name,
            "world": bundle.kind,
            "episode": label,
            "seed": str(begin.seed),
            "origin": episode.origin,
            "outcome": "success" if episode.success else "failure",
            "reason": episode.reason,
            "rate_hz": str(self._episodes.rate_hz),
            "units": "m, rad, N; forces along the axes of `base`, torques not recorded",
        }
        self._out.metadata("episode", facts)
        start = begin.model_dump(mode="python") | {"qpos": begin.qpos.tolist(), "ctrl": begin.ctrl.tolist()}
        self._out.attach("start.json", start)
        self._out.attach("task.json", bundle.task.model_dump(mode="json"))
        self._out.attach("segments.json", [segment.model_dump() for segment in episode.segments])

    def once(self, bundle: TaskBundle, seen: Sequence[Camera], episode: Episode) -> None:
        """Write static frames, the robot's description and shapes."""
        edges = [("world", BASE, poses.from_matrix(bundle.base_pose.matrix))]
        for each in seen:
            if each.view is not None:
                placed = bundle.base_pose.inverse() @ each.view.camera_pose
                edges.append((BASE, _optical(each), poses.from_matrix(placed.matrix)))
        sizes = episode.start.size_scale
        edges += self._shapes.fixed(sizes)
        joints = dict(zip(self._episodes.joint_names, episode.joints.T.astype(np.float64), strict=True))
        joints |= dict(zip(self._episodes.displacement_names, episode.displacement.T.astype(np.float64), strict=True))
        self._moving = self._shapes.moving(joints, sizes)
        if self._options.shapes == "each":
            self._shapes.send(self._out, 0, sizes)
        elif sizes:
            self._shapes.send_objects(self._out, 0, sizes, sizes)
        # In one message: late subscribers get only the last one.
        self._out.send("/tf_static", "tf2_msgs/TFMessage", 0, messages.transforms(0, edges), LATCHED)

    def step(self, episode: Episode, step: int) -> None:
        """Write the measurements and the command of a step."""
        t, reach = self._time(step), self._time(1)
        edges = [(parent, child, rows[step]) for parent, child, rows in self._moving]
        for term in self._terms:
            for topic, message in _messages(term, episode.values(term.declared.name)[step], t, reach, edges):
                self._out.send(topic, term.declared.message, t, message)

    def pictures(self, step: int, pictures: _Pictures) -> None:
        """Write a camera's next frame and its depth, if there are any, and its intrinsics if they are known."""
        t, camera = self._time(step), pictures.camera
        for encoded in islice(pictures.colours, 1):
            self._colours(t, camera, encoded)
            if camera.view is not None:
                info = messages.camera_info(t, _optical(camera), camera.view.camera)
                self._out.send(f"/{camera.name}/color/camera_info", "sensor_msgs/CameraInfo", t, info)
        for counts in islice(pictures.depths, 1):
            term, message = BY_NAME["depth"], messages.depth_image(t, _optical(camera), counts)
            self._out.send(term.topic.format(camera.name), term.message, t, message)

    def _colours(self, t: int, camera: Camera, encoded: bytes) -> None:
        term, kind = BY_NAME["rgb"], self._options.picture
        topic = place(term, kind).format(camera.name)
        if kind == "h264":
            video = messages.compressed_video(t, _optical(camera), kind, encoded)
            self._out.send(topic, "foxglove_msgs/CompressedVideo", t, video)
        else:
            self._out.send(topic, term.message, t, messages.compressed_image(t, _optical(camera), kind, encoded))

    def close(self) -> None:
        """Write the index and close the file."""
        self._out.finish()

    def _time(self, step: int) -> int:
        return round(step * messages.SECOND / self._episodes.rate_hz)


def _messages(
    term: Term, values: np.ndarray, t: int, reach: int, edges: list[tuple[str, str, np.ndarray]]
) -> list[tuple[str, bytes]]:
    """Topics and messages of one step of a term.

    Args:
        term: With a topic.
        values: Its numbers.
        t: Time of the step [ns].
        reach: Time until a target should be reached [ns].
        edges: Parent, child and pose of frames in addition to those of objects.
    """
    rows = list(zip(term.names, values, strict=True))
    match term.declared.message:
        case "sensor_msgs/JointState":
            return [(term.topic(), messages.joint_state(t, term.names, values))]
        case "trajectory_msgs/JointTrajectory":
            return [(term.topic(), messages.joint_trajectory(t, term.names, values, reach))]
        case "tf2_msgs/TFMessage":
            return [(term.topic(), messages.transforms(t, [*((BASE, name, row) for name, row in rows), *edges]))]
        case "geometry_msgs/PoseStamped":
            return [(term.topic(name), messages.pose(t, BASE, row)) for name, row in rows]
        case "geometry_msgs/WrenchStamped":
            return [(term.topic(name), messages.wrench(t, BASE, row)) for name, row in rows]
        case "std_msgs/Float64MultiArray":
            return [(term.topic(), messages.numbers(term.components, values))]
    raise NotImplementedError(term.declared.message)
