"""Executes one call inside a worker: loads the rule, decodes its inputs, calls it, checks and stores the result."""

from __future__ import annotations

import atexit
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build import digest as digests
from dextera_build.calls import secrets
from dextera_build.code.companions import of_paths
from dextera_build.code.distributions import version_of
from dextera_build.code.importer import IMPORTER
from dextera_build.code.loader import Library, RuleFile
from dextera_build.errors import DxbError, MachineError, RuleError, listing
from dextera_build.redact import hidden
from dextera_build.rule import Context, Options
from dextera_build.rule.pretrained import Device, Pretrained, out_of_memory, unload
from dextera_build.running import unnamed
from dextera_build.running.called import as_called, named, only_keyed, others, roots, running
from dextera_build.store import disk_full, headers
from dextera_build.store.entry import ActionResult
from dextera_build.store.questions import Look, Recording
from dextera_build.store.store import Store, opened

if TYPE_CHECKING:
    from dextera_build.artifacts.base import File
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.rule.outside import Outside

Emit = Callable[[str, Mapping[str, object]], None]


def run_task(task: Mapping[str, Any], emit: Emit) -> dict[str, Any]:
    """Run one task of the engine.

    Args:
        task: `rule`, `backend`, `options`, `inputs` (slot -> digest), `store`, `project`; `key` names the folder in
            which the call saves its progress (without it, a fresh one is used); `sources`, `companions` and `packages`
            describe the code that was digested into the key.
        emit: Takes progress and log lines as they occur.

    Returns:
        `output` (digest), `line`, `previews` ([caption, digest]), `metrics` (name -> [value, unit]).

    Raises:
        DxbError: The rule refused its inputs, a check failed, a disk is full, or code changed after it was digested.
    """
    try:
        return _run(task, emit)
    finally:
        IMPORTER.verify()


def _run(task: Mapping[str, Any], emit: Emit) -> dict[str, Any]:
    from dextera_build.artifacts.core.forms import type_among

    library = _library(task["project"])
    found = library.find(task["rule"])
    companions = of_paths(library, task.get("companions", {}))
    IMPORTER.want(task.get("sources", {}), roots(found, task["backend"], companions))
    _refuse_other_versions(task.get("packages", {}))
    store = opened(task["store"])
    with unnamed.opened() as opened_on_import:
        rule = found.rule
    inputs = {}
    for name, slot in rule.slots.items():
        if name in task["inputs"]:
            with headers.reading(f"the input `{name}`"):
                key = task["inputs"][name]
                inputs[name] = type_among(slot.annotation, key, store.reader).decode(key, store.reader)
    options, own = parted(found, task["backend"], task["options"])
    calls, reads = _Calls(task, store, emit), ProjectReads(Path(task["project"]), store) if rule.discovers else None
    with _full_disk_told(store), ExitStack() as folders, _full_disk_told(store):
        # Most calls need no folder, and creating one takes longer than a small call.
        ctx = Context(
            as_called(found, task["backend"]),
            own,
            scratch=lambda: Path(folders.enter_context(tempfile.TemporaryDirectory(prefix="dxb-"))),
            emit=emit,
            keep=_keep(task, store, reads),
            calls=calls,
            reads=reads,
            pretrained=pretrained(task, found),
            companions=running(companions),
            named=named(found, task["options"]),
        )
        keyword = {"options": options} if rule.takes_options else {}
        if reads is not None:
            folders.enter_context(_failure_told(reads, emit))
        with _memory_told(ctx), _umask_kept(), only_keyed(companions), unnamed.opened() as files:
            result = rule(ctx, **inputs, **keyword)
        files |= unnamed.imported(found.path, opened_on_import)
        _warn_of_unnamed(ctx, files, task, reads)
        # Before the scratch folder is removed, because the result may refer to files in it.
        wanted = rule.returned(options.model_dump())
        reply = _stored(store, found, wanted, result, ctx) | ({"calls": calls.made} if calls.made else {})
        return reply | ({"reads": reads.finish()} if reads is not None else {})


def parted(found: RuleFile, backend: str | None, given: Mapping[str, Any]) -> tuple[Options, Options]:
    """The options of a rule, and those of its backend, which lie below the backend's name, as those of a folder do.

    Args:
        found: The rule.
        backend: Name of its backend, if it has any.
        given: Options as JSON data.
    """
    kind = (found.backends[backend].options if backend else None) or Options
    groups = {*found.backends, *(given[option] for option in found.rule.folders)}
    common = {name: value for name, value in given.items() if name not in groups}
    # JSON mode accepts a list for a tuple, and the engine passes options as JSON. Canonical JSON, because the key does
    # not hold the order in which a recipe gives the items of a mapping, so no result may depend on it.
    return (
        found.rule.options.model_validate_json(digests.canonical(common)),
        kind.model_validate_json(digests.canonical(given.get(backend or "", {}))),
    )


def pretrained(task: Mapping[str, Any], found: RuleFile | None = None) -> Pretrained:
    """Resources of a task's backend: weights, device and, if its rule is given, its program and the backends it uses.

    Models of other weights, which the process keeps, are freed.
    """
    weights = tuple(task.get("weights", ()))
    backend = task.get("backend")
    program = outside(found, backend, task.get("program", {})) if found else None
    if weights:
        unload(but=weights)
        if program is None:
            _end_server()
    folders = [Path(folder) for folder in os.environ.get("DXB_MODELS", "").split(os.pathsep) if folder]

    def find(pinned: str) -> Path:
        from dextera_build.models.catalogue import folder_of

        return folder_of(folders, pinned)

    device: Device = "cuda" if task.get("devices") else "cpu"
    return Pretrained(weights, find, device, program, others(found, backend) if found else None)


def _end_server() -> None:
    """End the program that this process keeps, if there is one: it may hold a model, too."""
    if (servers := sys.modules.get("dextera_build.outside.servers")) is not None:
        servers.end()


@contextmanager
def _memory_told(ctx: Context) -> Iterator[None]:
    """Turn the errors of libraries that ran out of memory into one with a remedy."""
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        told = out_of_memory(error, ctx.device)
        if told is None:
            raise
        traceback.print_exc()
        unload()
        raise told from error


def _warn_of_unnamed(ctx: Context, files: set[str], task: Mapping[str, Any], reads: ProjectReads | None) -> None:
    asked = {word for step in reads.steps for word in step} if reads else set()
    asked |= set(task.get("program", {}))  # the key holds their digests
    if names := unnamed.unnamed(files, Path(task["project"]), Path(task["store"]), asked):
        ctx.warn(f"it opened {listing(names)}, which no input names: editing that makes nothing stale")


@contextmanager
def _umask_kept() -> Iterator[None]:
    """Store results with the usual permissions, even if a rule changes the file mask."""
    mask = os.umask(0o077)
    os.umask(mask)
    try:
        yield
    finally:
        os.umask(mask)


def outside(found: RuleFile, backend: str | None, key: Mapping[str, str]) -> Outside | None:
    """The program of a backend, if it declares one.

    Args:
        found: The rule.
        backend: Name of its backend, if it has any.
        key: Digests of the program's files, as in the key.
    """
    program = found.backends[backend].program if backend else None
    if program is None:
        return None
    from dextera_build.rule.outside import Outside

    return Outside(program, found.path, str(backend), key, found.rule.protocol)


def _refuse_other_versions(packages: Mapping[str, str]) -> None:
    """Raise if a package version differs from the key: on a cluster, or after an installation during the build."""
    for name, version in packages.items():
        if _installed(name) != version:
            raise MachineError(
                f"`{name}` has another version here than in this node's key",
                code="DXB-E353",
                facts={"machine": os.uname().nodename, "here": _installed(name) or "none", "in the key": version},
                hint="install the same version on every machine of a cluster; after an installation, build again",
            )


_installed = lru_cache(maxsize=None)(version_of)


def _keep(task: Mapping[str, Any], store: Store, reads: ProjectReads | None) -> Callable[[], Path] | None:
    """The folder for a call's saved progress; with discovered inputs, it also depends on the files read so far."""
    key: str = task.get("key", "")
    if not key:
        return None
    return lambda: store.keep.path(key) if reads is None else store.keep.path(key) / reads.close()


@contextmanager
def _failure_told(reads: ProjectReads, emit: Emit) -> Iterator[None]:
    """Report the discovered inputs of a failed call, because a fix may change one of them."""
    try:
        yield
    except BaseException:
        emit("read", {"steps": reads.steps})
        raise


class ProjectReads(Recording):
    """The discovered inputs of one call.

    Args:
        root: The project's folder.
        store: Stores the files that are read.

    Raises:
        MachineError: The folder is not on this machine.
    """

    def __init__(self, root: Path, store: Store) -> None:
        if not root.is_dir():
            raise MachineError(
                "a rule reads files of the project, whose folder is not on this machine",
                code="DXB-E370",
                facts={"folder": str(root)},
                hint="run it in the project's folder",
            )
        super().__init__(Look(root, store.leaves, store.root))
        self._store = store

    def file(self, path: str) -> File:
        """See `Context.file`."""
        from dextera_build.artifacts.base import File  # few rules discover inputs

        return File.decode(self.digest_of(path), self._store.reader)

    def finish(self) -> list[list[str]]:
        """Store the directory listings; returns all questions and answers.

        Raises:
            DxbError: A read failed, even if the rule caught the error.
        """
        if self.error is not None:
            raise self.error
        for names in self.listings.values():
            self._store.blobs.put(digests.canonical(names))
        return self.steps


class _Calls:
    """Answers the service calls of one node; the recorder is loaded on the first call, because few nodes make any."""

    def __init__(self, task: Mapping[str, Any], store: Store, emit: Emit) -> None:
        self._task, self._store, self._emit = task, store, emit
        self._recorder: Callable[..., bytes] | None = None
        self.made: list[dict[str, Any]] = []

    def __call__(self, *words: Any, **manner: Any) -> bytes:
        """The answer of a service, in the mode set by `DXB_CALLS`; profile `stub` never calls."""
        if self._recorder is None:
            from dextera_build.calls.recorder import Recorder
            from dextera_build.calls.terms import Terms

            wanted = "off" if self._task.get("profile") == "stub" else os.environ.get("DXB_CALLS") or "record"
            fetch = _fetcher(self._task, self._store)
            terms = Terms.read(os.environ.get("DXB_CALL_TERMS", ""))
            recorder = Recorder(self._store, wanted, fetch, self._emit, terms)
            self._recorder, self.made = recorder, recorder.made
        return self._recorder(*words, **manner)


def _fetcher(task: Mapping[str, Any], store: Store) -> Callable[[str], ActionResult | None]:
    """A function that looks for a recorded answer on the remotes of the project."""

    def fetch(key: str) -> ActionResult | None:
        exchange = _exchange(store, task["project"], secrets.variable(secrets.REMOTES))
        return exchange.fetch(key).result if exchange is not None else None

    return fetch


@lru_cache(maxsize=1)
def _exchange(store: Store, project: str, listed: str | None) -> Exchange | None:
    """The remotes of this worker, opened once; `listed` is the value of `DXB_REMOTES`, as `withhold` found it."""
    from dextera_build.project.project import Project
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.remotes.spec import guarded

    known = Project(Path(project), {"remotes": listed})
    used = known.used_remotes
    if not used:
        return None
    exchange = Exchange(store, [guarded(spec) for spec in used])
    atexit.register(exchange.close)  # if the worker is killed, the system closes the connections
    return exchange


def _stored(store: Store, found: RuleFile, wanted: Any, result: Any, ctx: Context) -> dict[str, Any]:
    from dextera_build.recipe.kinds import fits, type_name

    if not fits(wanted, type(result)):
        raise RuleError(
            f"{found.path} returned {type(result).__name__}, but {type_name(wanted)} is declared",
            code="DXB-B209",
            where=found.place,
        )
    writer: Callable[[bytes], str] = _careful(store.writer) if hidden() else store.writer
    return {
        "output": result.encode(writer),
        "line": ctx.outcome.told,
        "previews": [[caption, writer(data)] for caption, data in ctx.outcome.previews],
        "metrics": {name: list(value) for name, value in ctx.outcome.metrics.items()},
    }


def _careful(put: Callable[[bytes], str]) -> Callable[[bytes], str]:
    """`put`, refusing the secrets that rules requested in this process."""

    def checked(data: bytes) -> str:
        for value, name in hidden().items():
            if value.encode(errors="surrogateescape") in bytes(data):
                raise RuleError(
                    f"the result holds the secret `{name}`",
                    code="DXB-B363",
                    hint="use `ctx.secret` in requests to services only; nothing was stored",
                )
        return put(data)

    return checked


@contextmanager
def _full_disk_told(store: Store) -> Iterator[None]:
    """Convert a library's full-disk error to a `DxbError`, while the files that filled the disk still exist."""
    try:
        yield
    except DxbError:
        raise
    except Exception as error:
        full = disk_full.explain(error, store.root, Path(tempfile.gettempdir()))
        if full is None:
            raise
        with suppress(OSError):
            traceback.print_exc()
        raise full from None


@lru_cache(maxsize=1)
def _library(project: str) -> Library:
    return Library(Path(project))
