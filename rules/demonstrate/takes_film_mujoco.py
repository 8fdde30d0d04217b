"""demonstrate.takes_film rendered by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import cameras, poses, transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.render import ghosts, portrait
from dextera_build.sim.render.filming import Replica, in_world
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.retarget.matching import matched
from dextera_build.sim.retarget.motion import BASE, due

if TYPE_CHECKING:
    from .takes_film import TakesFilmOptions

BACKEND = Backend(
    summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco", "mink", "daqp", "pillow"), extra="learn"
)
FROM, AROUND_M = (0.5, -0.8, 0.45), 0.7
"""Direction to the camera in the robot's base, and its distance beside the way of the hands [m]."""
INK = (240, 246, 252)


def frames(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    recording: HandStream,
    common: TakesFilmOptions,
    options: Options,
) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8 of the takes."""
    drawing = _Drawing(bundle, episodes, recording, common.width_px)
    every = max(1, round(episodes.rate_hz / common.rate_hz))
    chosen = episodes.in_order()[: common.first]
    with drawing.eye:
        for number, (index, episode) in enumerate(chosen):
            yield from drawing.take(int(index), episode, every)
            ctx.progress(number + 1, len(chosen), "takes")


class _Drawing:
    """Draws steps of takes.

    Args:
        bundle: The task.
        episodes: The episodes of the takes.
        recording: The operator's hands.
        width_px: Width of a picture [px].
    """

    def __init__(self, bundle: TaskBundle, episodes: Episodes, recording: HandStream, width_px: int) -> None:
        self._replica, self._recording, self._rate = Replica(bundle, episodes), recording, episodes.rate_hz
        self._base, self._limbs = bundle.base_pose.matrix, bundle.robot.limb_names
        model = self._replica.model
        self._hands = {limb: matched(bundle.robot, limb) for limb in self._limbs}
        self._bodies = {
            limb: [model.body(ROBOT + link).id for link in own.hand.links] for limb, own in self._hands.items()
        }
        self._motors = {
            limb: [episodes.joint_names.index(name) for name in bundle.robot.limbs[limb].hand] for limb in self._hands
        }
        camera, _ = portrait.stand(model, self._replica.data, width_px, width_px * 3 // 4)
        self.eye = Eye(model, camera, self._view(episodes.in_order()[0][1]))

    def _view(self, episode: Episode) -> np.ndarray:
        """T_world_camera (4, 4) of a camera that looks between the hands and what they move, from before the robot."""
        palms = episode.hand[:, :, :3].reshape(-1, 3).astype(np.float64)
        middle = (palms.min(axis=0) + palms.max(axis=0)) / 2
        far = np.linalg.norm(np.ptp(palms, axis=0)) + AROUND_M
        eye = middle + far * np.array(FROM) / np.linalg.norm(FROM)
        return cameras.look_at(transforms.apply(self._base, eye), transforms.apply(self._base, middle))

    def take(self, number: int, episode: Episode, every: int) -> Iterator[np.ndarray]:
        """Pictures (H, W, 3) uint8 of a take, one of so many steps."""
        heard = self._recording.during(self._recording.demonstrations[number])
        times = heard.stamps - heard.stamps[0]
        result = "done" if episode.success else f"not done: {episode.reason}"
        positions = self._replica.positions(episode)
        for step in range(0, len(positions), every):
            self._replica.show(positions[step])
            row = int(np.searchsorted(times, due(step, 1 / self._rate), side="right")) - 1
            self.eye.overlay = lambda scene, step=step, row=row: self._hands_in(scene, episode, step, heard, row)
            words = [f"take {number + 1}, {step / self._rate:.1f} s, {result}"]
            words += ["a program made the hands: no person, no headset"] if heard.synthetic else []
            yield _worded(self.eye.rgb(self._replica.data), words)

    def _hands_in(self, scene: Any, episode: Episode, step: int, heard: HandStream, row: int) -> None:
        for limb, own in self._hands.items():
            palm = poses.to_matrix(episode.hand[step, self._limbs.index(limb)].astype(np.float64))
            links = own.hand.link_poses(episode.action[step, self._motors[limb]].astype(np.float64), palm)
            ghosts.add_links(scene, self._replica.model, self._bodies[limb], in_world(self._base, links))
        for hand in np.flatnonzero(heard.tracking[row] > LOST).tolist() if heard.frame == BASE else []:
            points = heard.positions[row, hand].astype(np.float64)
            ghosts.add_skeleton(scene, transforms.apply(self._base, points), hand)


def _worded(picture: np.ndarray, lines: list[str]) -> np.ndarray:
    from PIL import Image, ImageDraw

    drawn = Image.fromarray(picture)
    pen = ImageDraw.Draw(drawn)
    for number, line in enumerate(lines):
        pen.text((8, 6 + 14 * number), line, fill=INK, stroke_width=1, stroke_fill=(22, 27, 34))
    return np.asarray(drawn)
