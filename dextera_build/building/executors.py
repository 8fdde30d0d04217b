"""The executor of a build, and the environment of its workers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, TypeAlias

from dextera_build.errors import UsageError, listing

if TYPE_CHECKING:
    from pathlib import Path

    from dextera_build.engine.graph import RuleFacts
    from dextera_build.project.project import Project
    from dextera_build.session import Session
    from dextera_build.workers.protocol import Executor

RUNNER = "dextera_build.running.worker_entry:run_task"
_SCRATCH = "dxb-build-"

_PINNED = {
    # One thread per worker: sums do not depend on the number of cores, and workers do not compete for them.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    # Sets have one order, asserts are checked, text is UTF-8, and numbers and times are written in one way.
    "PYTHONHASHSEED": "0",
    "PYTHONOPTIMIZE": "",
    "PYTHONUTF8": "1",
    **dict.fromkeys(("LANG", "LC_ALL"), "C.UTF-8"),
    "LANGUAGE": "",
    "TZ": "UTC",
}
"""Variables of workers, and of the programs and processes that they start: results depend on them, keys do not."""

Ready: TypeAlias = "Callable[[Sequence[RuleFacts]], Executor]"
"""Returns the executor of one build, given the rules that may run."""


@contextmanager
def executor(session: Session, *, idle: bool = False, warm: bool = True) -> Iterator[Ready]:
    """The configured executor of one build.

    Args:
        session: The recipe to build.
        idle: Nothing will run: start no worker, and look for no cluster or device.
        warm: Let a first worker load while the recipe is being planned.
    """
    project = session.project
    kind, _, address = project.executor.partition(":")
    with ExitStack() as stack:
        if kind == "ray" and not idle:
            yield lambda rules: stack.enter_context(_ray(session, address, rules))
        else:
            yield stack.enter_context(local(project, idle=idle, warm=warm))


@contextmanager
def local(project: Project, *, idle: bool = False, warm: bool = False) -> Iterator[Ready]:
    """The executor of this machine, whichever one is configured; see `executor`."""
    from dextera_build.code.modules import shared
    from dextera_build.workers.pool import LocalExecutor

    with ExitStack() as stack:
        more, share = stack.enter_context(shared())
        environment, capacity = {**_environment(project), **more}, project.capacity(gpus=False)
        with suppress(OSError):  # few rules need a temporary folder
            environment["TMPDIR"] = stack.enter_context(scratch())
        workers = stack.enter_context(LocalExecutor(RUNNER, capacity, environment, project.root))
        if warm and not idle:
            workers.warm()

        def ready(rules: Sequence[RuleFacts]) -> Executor:
            share(project.library.code.files())
            if not idle and any(rule.gpus or rule.gpu_gb for rule in rules):
                workers.capacity = project.capacity(gpus=True)
            return workers

        yield ready


@contextmanager
def scratch() -> Iterator[str]:
    """A temporary folder for the duration of the block; also removes the folders of killed builds.

    A process locks the folder that it uses; the system releases the lock when the process dies.

    Raises:
        OSError: The folder cannot be created.
    """
    import fcntl
    import glob
    import shutil
    import tempfile

    for left in glob.glob(f"{glob.escape(tempfile.gettempdir())}/{_SCRATCH}*"):
        with suppress(OSError), ExitStack() as stack:
            lock = os.open(left, os.O_RDONLY | os.O_NOFOLLOW)
            stack.callback(os.close, lock)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(left, ignore_errors=True)
    made, lock = _claimed()
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)
        os.close(lock)


def _claimed() -> tuple[str, int]:
    """A new folder and the descriptor that holds its lock."""
    import fcntl
    import tempfile

    while True:
        made = tempfile.mkdtemp(prefix=_SCRATCH)
        with suppress(FileNotFoundError):  # another build removed it before it was locked
            lock = os.open(made, os.O_RDONLY)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if os.path.isdir(made):
                return made, lock
            os.close(lock)


def _environment(project: Project) -> dict[str, str]:
    from dextera_build.project.terms import terms

    environment = {**_PINNED, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}  # which one works, the machine decides
    # No rule uses pydantic plug-ins, and the search for them reads the metadata of every installed package.
    environment["PYDANTIC_DISABLE_PLUGINS"] = os.environ.get("PYDANTIC_DISABLE_PLUGINS", "__all__")
    environment["DXB_CALLS"] = project.calls
    environment["DXB_CALL_TERMS"] = terms(project)
    environment["DXB_MODELS"] = os.pathsep.join(map(str, project.model_folders))
    # The key holds the digests of declared weights only, so nothing else may be fetched while a rule runs.
    environment |= dict.fromkeys(("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE"), "1")
    if listed := project.remotes.listed:
        environment["DXB_REMOTES"] = listed
    return environment


@contextmanager
def _ray(session: Session, address: str, rules: Sequence[RuleFacts]) -> Iterator[Executor]:
    from pathlib import Path

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
    if project.max_cost is not None:
        raise UsageError(
            "the machines of a cluster share no account of costs, so `max_cost` cannot be kept",
            code="DXB-U180",
            facts={"executor": project.executor, "from": project.config["max_cost"].origin},
            hint="`--executor local`, or `--max-cost none`",
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
    with scratch() as code:
        for file in _code(project):
            target = Path(code, file.relative_to(project.root))
            target.parent.mkdir(parents=True, exist_ok=True)
            # Copy code as it was digested, because the file may have been edited since.
            target.write_bytes(read(file) if file.suffix == ".py" else file.read_bytes())
        cluster = RayCluster(address, Path(code))
        with RayExecutor(cluster, session.store, setup, said=said, discovering=discovering) as workers:
            yield workers


def _code(project: Project) -> set[Path]:
    """Project files that workers need: settings, everything below `rules/`, and project modules that rules import."""
    from dextera_build.code.modules import PACKAGE

    root, code = project.root, project.library.code
    own = {file for file in (root / "rules").rglob("*") if file.is_file() and not _is_hidden(file.relative_to(root))}
    code.of(*(file for file in own if file.suffix == ".py"))
    imported = {file for file in code.files() if file.is_relative_to(root) and not file.is_relative_to(PACKAGE)}
    return own | imported | {file for name in ("dxb.toml", "pyproject.toml") if (file := root / name).is_file()}


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") or part == "__pycache__" for part in path.parts)
