"""Task bundles for Gymnasium, by name.

    import gymnasium
    import dextera_build.envs  # registers the bundles in the folders of `DXB_BUNDLES`

    environment = gymnasium.make("dxb/LiftBlueMug-KL-v0")

A file `LiftBlueMug-KL-v0.bundle` is `dxb/LiftBlueMug-KL-v0`. Nothing but Gymnasium is imported until one is made.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium

if TYPE_CHECKING:
    from dextera_build.artifacts.tasks.task import TaskBundle

NAMESPACE = "dxb"
"""First part of the names."""
VARIABLE = "DXB_BUNDLES"
"""Environment variable with folders of bundles, separated as in `PATH`."""


def register(name: str, bundle: TaskBundle | str | Path | None = None) -> None:
    """Register `name` for `gymnasium.make` and `gymnasium.make_vec`.

    Args:
        name: `dxb/<task>-<embodiment>-v0`, in Gymnasium's format.
        bundle: The task, or its file; None: pass `bundle=...` to `make`.
    """
    # The task has its own time limit, so Gymnasium adds none.
    gymnasium.register(
        id=name,
        entry_point="dextera_build.sim.training.gym:TaskEnv",
        vector_entry_point="dextera_build.sim.training.vector:TaskVectorEnv",
        kwargs={} if bundle is None else {"bundle": bundle},
    )


def register_folder(folder: str | Path) -> list[str]:
    """Register every `<task>-<embodiment>-v<number>.bundle` in a folder, and return the names, sorted."""
    names = []
    for file in sorted(Path(folder).glob("*.bundle")):
        if re.search(r"-v\d+$", file.stem):
            names.append(f"{NAMESPACE}/{file.stem}")
            register(names[-1], file)
    return names


for _folder in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
    register_folder(_folder)
