"""Task bundles for Gymnasium, by name.

    import gymnasium

    environment = gymnasium.make("dextera_build.envs:dxb/Task-v0", bundle="LiftBlueMug-KL-v0")

`bundle` is a file, a reference of a registry, or a name that is looked up in the folders of `DXB_BUNDLES` when the
environment is made; see `find`. Files that are there when this module is imported have names of their own, too:
`LiftBlueMug-KL-v0.bundle` is `dxb/LiftBlueMug-KL-v0`. Nothing but Gymnasium is imported until an environment is made.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium

from dextera_build.errors import UsageError, did_you_mean, listing

if TYPE_CHECKING:
    from dextera_build.artifacts.tasks.task import TaskBundle
    from dextera_build.sim.training.gym import TaskEnv
    from dextera_build.sim.training.vector import TaskVectorEnv

NAMESPACE = "dxb"
"""First part of the names."""
ANY = f"{NAMESPACE}/Task-v0"
"""The environment whose task is the argument `bundle` of `make`."""
VARIABLE = "DXB_BUNDLES"
"""Environment variable with folders of bundles, separated as in `PATH`."""


def register(name: str, bundle: TaskBundle | str | Path | None = None) -> None:
    """Register `name` for `gymnasium.make` and `gymnasium.make_vec`.

    Args:
        name: `dxb/<task>-<embodiment>-v0`, in Gymnasium's format.
        bundle: The task, or what `find` takes; None: pass `bundle=...` to `make`.
    """
    # The task has its own time limit, so Gymnasium adds none.
    gymnasium.register(
        id=name,
        entry_point="dextera_build.envs:make",
        vector_entry_point="dextera_build.envs:make_vec",
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


def find(bundle: TaskBundle | str | Path) -> TaskBundle:
    """The task of an environment.

    Args:
        bundle: A task; the path of its `task.bundle`, or of a `.tar` of `dxb bundle create`; a reference of skopeo
            (`docker://ghcr.io/lab/mug:v1`), which is copied each time; or a name in the folders of `DXB_BUNDLES`.

    Raises:
        UsageError: There is no such file, or the bundle has no task or several.
        BundleRefused: Something in the bundle is wrong.
        MachineError: skopeo is missing, or could not copy the bundle.
        ArtifactError: The file is damaged, or contains something else.
    """
    from dextera_build.building import task_of_bundle
    from dextera_build.sim.training.gym import opened

    if isinstance(bundle, str) and task_of_bundle.is_reference(bundle):
        return task_of_bundle.read(bundle)
    if not isinstance(bundle, str | Path):
        return bundle
    path = _file(bundle)
    return task_of_bundle.read(path) if path.suffix == ".tar" else opened(path)


def make(bundle: TaskBundle | str | Path, **options: Any) -> TaskEnv:
    """One environment of a task that `find` finds; `options` are those of `sim.training.gym.TaskEnv`."""
    from dextera_build.sim.training.gym import TaskEnv

    return TaskEnv(find(bundle), **options)


def make_vec(bundle: TaskBundle | str | Path, num_envs: int = 1, **options: Any) -> TaskVectorEnv:
    """Several copies; `options` are those of `sim.training.vector.TaskVectorEnv`."""
    from dextera_build.sim.training.vector import TaskVectorEnv

    return TaskVectorEnv(find(bundle), num_envs, **options)


def _file(bundle: str | Path) -> Path:
    """The file that a path or a name means."""
    if Path(bundle).is_file():
        return Path(bundle)
    named = {file.stem: file for folder in _folders() for file in sorted(Path(folder).glob("*.bundle"))}
    name = str(bundle).removeprefix(f"{NAMESPACE}/")
    if name not in named:
        raise UsageError(
            f"there is no bundle `{bundle}`: no such file, and none of that name in the folders of `{VARIABLE}`",
            code="DXB-U154",
            facts={VARIABLE: os.environ.get(VARIABLE, "not set"), "bundles there": listing(named)},
            hint=did_you_mean(name, named) or "`dxb get task/close_laptop:task --out DIR` writes DIR/task.bundle",
        )
    return named[name]


def _folders() -> Iterator[str]:
    return filter(None, os.environ.get(VARIABLE, "").split(os.pathsep))


register(ANY)
for _folder in _folders():
    register_folder(_folder)
