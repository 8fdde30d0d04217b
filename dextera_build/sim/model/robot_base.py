"""Apply an error to the base pose of a compiled model's robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dextera_build.errors import RuleError
from dextera_build.geometry import lie, quaternions, transforms
from dextera_build.sim.model.compose import ROBOT


class RobotBase:
    """Keeps the original base pose of a model's robot and applies errors to that, never to an earlier error's result.

    Args:
        world_from_base: (4, 4) T_world_base of the model.
        model: The unmodified compiled model.

    Raises:
        RuleError: The model has no robot, as those of the stub of `simulate.task`.
    """

    def __init__(self, world_from_base: np.ndarray, model: Any) -> None:
        self._known = world_from_base
        self._body = _base(model)
        self._place, self._turn = model.body_pos[self._body].copy(), model.body_quat[self._body].copy()

    def pose(self, error: Sequence[float]) -> np.ndarray:
        """T_world_base (4, 4) with an error (6,), see `geometry.uncertainty`."""
        return lie.retract(self._known, error) if any(error) else self._known

    def put(self, model: Any, error: Sequence[float]) -> None:
        """Set the base of `model`, or of a copy of it, with an error (6,); zeros restore the compiled pose exactly."""
        place, turn = self._place, self._turn
        if any(error):
            # The body may have an offset in the frame `base`, which is kept.
            own = transforms.rigid(quaternions.to_matrix(turn), place)
            body = self.pose(error) @ transforms.invert(self._known) @ own
            place, turn = body[:3, 3], quaternions.from_matrix(body[:3, :3])
        model.body_pos[self._body], model.body_quat[self._body] = place, turn


def _base(model: Any) -> int:
    try:
        return int(model.body(ROBOT + "base").id)
    except KeyError:
        raise RuleError(
            "the model of the task has no robot, so it cannot be simulated",
            code="DXB-B527",
            facts={"body": ROBOT + "base"},
            hint="the stub of `simulate.task` makes such a model; build the task with `--backend simulate.task=mujoco`",
        ) from None
