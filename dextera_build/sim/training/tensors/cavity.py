"""Whether objects are in the cavity of a container, in many worlds at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.task import Cavity
from dextera_build.sim.training.tensors.cells import constant


def in_cavity(cavity: Cavity, skin_m: float, points: np.ndarray, pose: Tensor, container: Tensor) -> Tensor:
    """Whether all points of an object are in a cavity (N,), as `pick_and_place.primitive.inside` of one world.

    Args:
        cavity: Cavity in the container's frame.
        skin_m: How far a point may be in the walls [m].
        points: Points of the object in its frame (P, 3) [m].
        pose: T_world_object (N, 4, 4).
        container: T_world_container (N, 4, 4).
    """
    pose, container = pose.as_subclass(Tensor), container.as_subclass(Tensor)
    known: list[Any] = [cavity.floor_m, cavity.rim_m, cavity.corner_m, points]
    floor, rim, corner, shape = (constant(part, pose.device).as_subclass(Tensor) for part in known)
    world = shape @ pose[:, :3, :3].transpose(1, 2) + pose[:, None, :3, 3]
    local = (world - container[:, None, :3, 3]) @ container[:, :3, :3]
    cell = torch.floor((local[..., :2] - corner) / cavity.cell_m).nan_to_num(nan=-9.0).clamp(-9, max(rim.shape) + 9)
    found = torch.zeros(local.shape[:2], dtype=torch.bool, device=pose.device)
    for across in (-1, 0, 1):
        for along in (-1, 0, 1):
            row, column = (cell[..., 0] + across).long(), (cell[..., 1] + along).long()
            there = (row >= 0) & (row < rim.shape[0]) & (column >= 0) & (column < rim.shape[1])
            row, column = row.clamp(0, rim.shape[0] - 1), column.clamp(0, rim.shape[1] - 1)
            low, high = floor[row, column], rim[row, column]
            between = (local[..., 2] >= low - skin_m) & (local[..., 2] <= high + skin_m)
            found |= there & (high - low > 0) & between
    return found.all(dim=1)
