"""Which executor a build uses, and what its workers are told."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError, listing

if TYPE_CHECKING:
    from pathlib import Path

    from dextera_build.engine.graph import RuleFacts
    from dextera_build.project.project import Project
    from dextera_build.session import Session
    from dextera_build.workers.protocol import Executor

RUNNER = "dextera_build.build.worker_entry:run_task"


@contextmanager
def executor(session: Session, rules: Iterable[RuleFacts], *, idle: bool = False) -> Iterator[Executor]:
    """What runs the nodes of one build, as the settings say.

    Args:
        session: The recipe that is built.
        rules: Those that may run.
        idle: Nothing will run, so that no cluster and no device is looked for.
    """
    kind, _, address = session.project.executor.partition(":")
    if kind == "ray" and not idle:
        yield from _ray(session, address, list(rules))
    else:
        from dextera_build.code.modules import shared
        from dextera_build.workers.pool import LocalExecutor

        project = session.project
        wants_gpu = not idle and any(rule.gpus or rule.gpu_gb for rule in rules)
        capacity = project.capacity(gpus=wants_gpu)
        with shared() as more:
            environment = {**_environment(project), **more}
            with LocalExecutor(RUNNER, environment=environment, capacity=capacity) as workers:
                if not idle:
                    workers.warm()  # a build whose snapshot is not fresh mostly runs something
                yield workers


def _environment(project: Project) -> dict[str, str]:
    # One thread per worker: sums do not depend on the machine's cores, and workers do not fight for them.
    environment = {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    # No rule uses pydantic plug-ins, and the search for them reads the metadata of every installed package.
    environment["PYDANTIC_DISABLE_PLUGINS"] = os.environ.get("PYDANTIC_DISABLE_PLUGINS", "__all__")
    environment["DXB_CALLS"] = project.calls
    if listed := project.remotes.listed:
        environment["DXB_REMOTES"] = listed
    return environment


def _ray(session: Session, address: str, rules: list[RuleFacts]) -> Iterator[Executor]:
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from dextera_build.code.modules import read
    from dextera_build.workers.ray import RayExecutor
    from dextera_build.workers.ray_cluster import RayCluster
    from dextera_build.workers.ray_worker import Setup

    project = session.project
    if project.asks_again:
        raise UsageError(
            f"`--calls {project.calls}` asks services again, which a build on a cluster cannot",
            code="DXB-U179",
            facts={"executor": project.executor},
            hint=f"`--executor local --calls {project.calls}`",
        )
    shared = next((spec for spec in project.used_remotes if spec.mode == "rw"), None)
    if shared is None:
        raise UsageError(
            "a build on a cluster needs a remote that all its machines can read and write",
            code="DXB-U195",
            facts={"remotes": listing(f"{spec.name} ({spec.mode})" for spec in project.used_remotes)},
            hint='in `dxb.toml`: [remotes] shared = {address = "/mnt/shared/dxb", mode = "rw"}',
        )
    said = dict(project.config["resources"].value)
    if project.config["jobs"].origin != "default":
        said["cpu"] = float(project.jobs)
    setup = Setup(RUNNER, shared, _environment(project))
    discovering = {rule.path for rule in rules if rule.discovers}
    with TemporaryDirectory(prefix="dxb-code-") as code:
        for file in _code(project):
            target = Path(code, file.relative_to(project.root))
            target.parent.mkdir(parents=True, exist_ok=True)
            # Of code the bytes that were digested, for it may have been edited since.
            target.write_bytes(read(file) if file.suffix == ".py" else file.read_bytes())
        cluster = RayCluster(address, Path(code))
        with RayExecutor(cluster, session.store, setup, said=said, discovering=discovering) as workers:
            yield workers


def _code(project: Project) -> set[Path]:
    """What workers need of the project: its settings, all below `rules/`, and its own modules that rules import."""
    from dextera_build.code.modules import PACKAGE

    root, code = project.root, project.library.code
    own = {file for file in (root / "rules").rglob("*") if file.is_file() and not _is_hidden(file.relative_to(root))}
    code.of(*(file for file in own if file.suffix == ".py"))
    imported = {file for file in code.files() if file.is_relative_to(root) and not file.is_relative_to(PACKAGE)}
    return own | imported | {file for name in ("dxb.toml", "pyproject.toml") if (file := root / name).is_file()}


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") or part == "__pycache__" for part in path.parts)
