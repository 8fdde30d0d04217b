"""Where pictures of a task show its robot and objects, and the scene without them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.variation import EXACT, Twist, Variation
from dextera_build.geometry import lie
from dextera_build.policy.cameras import PICTURE
from dextera_build.sim.model import model as models
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.observe.eyes import Eyes
from dextera_build.sim.render import rendering
from dextera_build.sim.render.filming import Replica
from dextera_build.sim.runtime import variations

HIDDEN = 5
"""Group of geoms that no camera of a policy draws."""


def masks(
    bundle: TaskBundle, episodes: Episodes, view: View, camera: str = PICTURE
) -> Iterator[tuple[str, np.ndarray]]:
    """Index of each episode, and the pixels (T, H, W) bool of robot and objects in its film by `pictures.film`."""
    replica, views = Replica(bundle, episodes), {camera: view}
    shown = np.append(_geoms(replica.model, bundle), False)
    with rendering.through(replica.model, view) as eye:
        for index, episode in episodes.items.items():
            error = variations.seen(bundle, episode.start, views).cameras.get(camera, EXACT)
            eye.look_from(lie.retract(view.camera_pose.matrix, error))
            found = []
            for row in replica.positions(episode):
                replica.show(row)
                found.append(shown[eye.segmentation(replica.data)])
            yield index, np.stack(found)


def behind(bundle: TaskBundle, view: View, draws: Sequence[tuple[Twist, float]]) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8 of the scene without robot and objects.

    Args:
        bundle: The task.
        view: The camera.
        draws: Error of the camera's pose and factor of the light of each picture.
    """
    model = models.compile_folder(bundle.model)
    data = models.at_home(model)
    model.geom_group[_geoms(model, bundle)] = HIDDEN
    mujoco.mj_camlight(model, data)
    with closing(Eyes(model, {PICTURE: view}, ("rgb",))) as eyes:
        for error, light in draws:
            eyes.vary(Variation(cameras={PICTURE: error}, light=light))
            picture = eyes.look(data)[PICTURE].rgb
            assert picture is not None
            yield picture


def _geoms(model: Any, bundle: TaskBundle) -> np.ndarray:
    """Geoms (G,) bool of the robot, of the task's objects, and of whatever else can move."""
    roots = [model.body(root).name for root in model.body_rootid]
    own = np.array([name.startswith(ROBOT) or name in bundle.objects for name in roots])
    return np.asarray((own | (model.body_weldid != 0))[model.geom_bodyid])
