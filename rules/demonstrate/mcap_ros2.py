"""demonstrate.mcap with ROS 2 messages in CDR."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from dextera_build.artifacts.episode import Episode, Episodes, Film
from dextera_build.artifacts.ros import messages
from dextera_build.artifacts.ros.recording import Recording, packed
from dextera_build.artifacts.task import TaskBundle, View
from dextera_build.geometry import poses
from dextera_build.rule import Backend, Context, Options

from .mcap_scene import Drawn

if TYPE_CHECKING:
    from .mcap import McapOptions

BACKEND = Backend(
    summary="ROS 2 messages in CDR, schemas as ros2msg",
    profiles=("cpu",),
    packages=("mcap", "mujoco", "zstandard"),
    extra="learn",
)
BASE = "base"
"""The robot's base frame."""
FOREVER = "{sec: 9223372036, nsec: 854775807}"
LATCHED = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, avoid_ros_namespace_conventions: false, "
    f"deadline: {FOREVER}, lifespan: {FOREVER}, liveliness_lease_duration: {FOREVER}}}"
)
"""Quality of service of one-time messages: reliable and transient local, for late subscribers."""


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None,
    view: View | None,
    out: Path,
    common: McapOptions,
    options: Options,
) -> None:
    """Write each recording below `out`."""
    drawn = Drawn(bundle)
    if drawn.clashes:
        ctx.fail("an object has the name of a link of the robot", names=", ".join(sorted(drawn.clashes)))
    for number, (label, episode) in enumerate(episodes.in_order()):
        pictures = film.each(label) if film is not None else None
        with (out / f"episode-{number:06d}.mcap").open("wb") as file:
            recording = EpisodeRecording(file, episodes, common, drawn)
            recording.describe(bundle, label, episode)
            recording.once(bundle, view, episode)
            for step in range(len(episode.joints)):
                recording.step(episode, step)
                if pictures is not None:
                    recording.picture(step, next(pictures), view)
            recording.close()
        ctx.progress(number + 1, len(episodes.items), "recordings")


class EpisodeRecording:
    """One MCAP file.

    Args:
        file: Where to write.
        episodes: Names and rate of the recorded channels.
        options: Name of the camera, image encoding, compression.
        drawn: Links and shapes of the task.
    """

    def __init__(self, file: BinaryIO, episodes: Episodes, options: McapOptions, drawn: Drawn) -> None:
        self._episodes, self._options, self._drawn = episodes, options, drawn
        self._out = Recording(file, options.compression)
        self._optical = f"{options.camera}_color_optical_frame"

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

    def once(self, bundle: TaskBundle, view: View | None, episode: Episode) -> None:
        """Write static frames, the robot's description and shapes."""
        edges = [("world", BASE, poses.from_matrix(bundle.base_pose.matrix))]
        if view is not None:
            camera = bundle.base_pose.inverse() @ view.camera_pose
            edges.append((BASE, self._optical, poses.from_matrix(camera.matrix)))
        edges += self._drawn.fixed(episode)
        self._moving = self._drawn.moving(self._episodes, episode)
        self._drawn.send(self._out, episode, LATCHED)
        # In one message: late subscribers get only the last one.
        self._out.send("/tf_static", "tf2_msgs/TFMessage", 0, messages.transforms(0, edges), LATCHED)

    def step(self, episode: Episode, step: int) -> None:
        """Write the measurements and the command of a step."""
        names, t, reach = self._episodes.joint_names, self._time(step), self._time(1)
        self._out.send(
            "/joint_states", "sensor_msgs/JointState", t, messages.joint_state(t, names, episode.joints[step])
        )
        for topic, targets in (("/joint_trajectory", episode.action), ("/executed/joint_trajectory", episode.executed)):
            message = messages.joint_trajectory(t, names, targets[step], reach)
            self._out.send(topic, "trajectory_msgs/JointTrajectory", t, message)
        limbs = self._episodes.limb_names
        for limb, pose in zip(limbs, episode.hand[step], strict=True):
            topic = "/target/hand" if len(limbs) == 1 else f"/target/{limb}/hand"
            self._out.send(topic, "geometry_msgs/PoseStamped", t, messages.pose(t, BASE, pose))
        objects = zip(self._episodes.object_names, episode.objects[step], strict=True)
        edges = [(BASE, name, pose) for name, pose in objects]
        edges += [(parent, child, rows[step]) for parent, child, rows in self._moving]
        self._out.send("/tf", "tf2_msgs/TFMessage", t, messages.transforms(t, edges))
        if self._episodes.displacement_names:
            inner = messages.joint_state(t, self._episodes.displacement_names, episode.displacement[step])
            self._out.send("/objects/joint_states", "sensor_msgs/JointState", t, inner)
        for tip, force in zip(self._episodes.tip_names, episode.contact[step], strict=True):
            message = messages.wrench(t, BASE, force)
            self._out.send(f"/wrench/{tip}", "geometry_msgs/WrenchStamped", t, message)

    def picture(self, step: int, pixels: np.ndarray, view: View | None) -> None:
        """Write a frame (H, W, 3) uint8 sRGB, and the camera's intrinsics if known."""
        t, topic = self._time(step), f"/{self._options.camera}/color"
        image = messages.compressed_image(
            t, self._optical, self._options.picture, packed(pixels, self._options.picture)
        )
        self._out.send(f"{topic}/image_raw/compressed", "sensor_msgs/CompressedImage", t, image)
        if view is not None:
            info = messages.camera_info(t, self._optical, view.camera)
            self._out.send(f"{topic}/camera_info", "sensor_msgs/CameraInfo", t, info)

    def close(self) -> None:
        """Write the index; nothing can follow."""
        self._out.finish()

    def _time(self, step: int) -> int:
        return round(step * messages.SECOND / self._episodes.rate_hz)
