"""Still pictures of recorded episodes, for film strips."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.layout import gathered
from dextera_build.sim.render import portrait
from dextera_build.sim.render.filming import Replica
from dextera_build.sim.render.rendering import Eye


class Stills:
    """Renders recorded states of one world, without stepping.

    Args:
        bundle: The task of the episodes; their arrays are in its order.
        view: The camera; None: in front of the table.
        width_px: Width of a picture [px], independent of the camera's size.
    """

    def __init__(self, bundle: TaskBundle, view: View | None, width_px: int = 240) -> None:
        self._replica = Replica(bundle, gathered(bundle, {}, {}, 0))
        if view is None:
            place = portrait.stand(self._replica.model, self._replica.data, width_px, width_px * 3 // 4)
        else:
            place = view.camera.scaled(width_px / view.camera.width), view.camera_pose.matrix
        self._place = place

    def at(self, episode: Episode, rows: np.ndarray) -> np.ndarray:
        """Pictures (len(rows), H, W, 3) uint8 of the scene before action `rows[i]`, clamped to the last."""
        positions = self._replica.positions(episode)
        if not len(positions):  # it still has a start
            positions = episode.start.qpos[None]
        with Eye(self._replica.model, *self._place) as eye:
            pictures = []
            for row in np.minimum(rows, len(positions) - 1):
                self._replica.show(positions[row])
                pictures.append(eye.rgb(self._replica.data))
        return np.stack(pictures)
