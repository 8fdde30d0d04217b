"""Recorded states in the model: joints without a motor follow their leaders."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import Follower
from dextera_build.sim.render.filming import Replica
from tests import episodes


def test_followers_are_where_their_leaders_put_them() -> None:
    bundle, made = episodes.bundle(), episodes.small(1, 6)
    scene = bundle.model.files["scene.xml"].decode()
    finger = '<body><joint name="robot/curl"/><geom size="0.01"/></body><site name="robot/flange"'
    scene = scene.replace('<site name="robot/flange"', finger).replace(' 0.9"', ' 0.9 0"', 1)
    robot = bundle.robot.model_copy(
        update={"followers": (Follower(name="curl", group="hand", leader="joint_3", ratio=-0.5, offset=0.1),)}
    )
    coupled = bundle.model_copy(update={"model": Folder(files={"scene.xml": scene.encode()}), "robot": robot})
    episode = made.items["0"]
    start = episode.start.model_copy(update={"qpos": np.append(episode.start.qpos, 0.0)})
    replica = Replica(coupled, made)
    found = replica.positions(episode.model_copy(update={"start": start}))
    np.testing.assert_allclose(found[:, -1], 0.1 - 0.5 * episode.joints[:, 2], atol=1e-7)
