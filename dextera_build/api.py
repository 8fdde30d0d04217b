"""The Python API of dxb: the verbs of the command line. Nothing is printed; failures raise a `DxbError`.

Start with `from dextera_build import Project`; docs/python_api.md has a worked example.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypedDict, Unpack

from dextera_build.building import build as building
from dextera_build.building.lock import Locking
from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.project import project as settings_of
from dextera_build.project.planning import Added
from dextera_build.recipe.addresses import parse_target
from dextera_build.runs.events import Listener
from dextera_build.session import Session, addresses

if TYPE_CHECKING:
    from dextera_build.artifacts.base import Artifact
    from dextera_build.engine.dry import Planned
    from dextera_build.errors import DxbError
    from dextera_build.explain.causes import Cause
    from dextera_build.runs.events import NodeFinished


@dataclass(frozen=True)
class Result:
    """The outcome of a build."""

    ok: bool
    """Whether every target is up to date."""
    run: str
    """Id of the run, for `dxb log` and `dxb report`; "" if the store cannot be written."""
    nodes: Mapping[str, NodeFinished]
    """Address -> record of the node: `status`, `output`, `line`, `seconds`, `key`, ..."""
    targets: tuple[str, ...]
    """Addresses of the requested nodes, one for each copy."""
    paths: Mapping[str, Path]
    """Address of a target -> its main file below `<cache>/out/`."""
    errors: Mapping[str, DxbError]
    """Address of a failed node, group or target -> its error."""
    _session: Session = field(repr=False)

    def __repr__(self) -> str:
        became = "ok" if self.ok else f"failed: {listing(self.errors, most=3)}"
        counts = f"{len(self.nodes):,} nodes, {len(self.targets):,} targets"
        return f"Result({became}, run {self.run or 'not kept'}, {counts})"

    def artifact(self, node: str) -> Artifact:
        """The artifact of a node: `scene`, `body[mug].mesh`.

        Raises:
            UsageError: The build had no such node, or the node has no output.
        """
        record = self.nodes.get(node)
        if record is None or record.output is None:
            known = [name for name, other in self.nodes.items() if other.output is not None]
            raise UsageError(
                f"`{node}` is not a node of this build"
                if record is None
                else f"`{node}` returned nothing: {record.status}",
                code="DXB-U162",
                facts={"nodes that returned something": listing(known, most=30)},
                hint=did_you_mean(node, known),
            )
        return self._session.decoded(node, record.rule, record.output)


@dataclass(frozen=True)
class Why:
    """Why a node is stale, or when it was built."""

    node: str
    answer: str
    """One sentence."""
    causes: tuple[Cause, ...]
    """The changes, each followed by its own causes at a greater `depth`."""


class RequestArguments(TypedDict, total=False):
    """Additions of a request to a recipe; every verb takes these as keyword arguments."""

    inputs: Mapping[str, str | os.PathLike[str]]
    """Input of the recipe -> path (from the current folder) or target of another recipe."""
    settings: Mapping[str, object]
    """`body[mug].mesh.primitives.wall_m` -> value; overrides the recipe."""
    backends: Mapping[str, str]
    """Rule -> backend."""
    profile: str
    """`stub`, `cpu`, `picture`, `gpu` or `cloud`."""


class Project(settings_of.Project):
    """A project folder and its verbs."""

    @classmethod
    def find(cls, path: Path | str | None = None, **settings: object) -> Self:
        """The project that contains `path` (default: the current folder), or the folder itself if there is none.

        Args:
            path: A folder.
            settings: `cache`, `profile`, `jobs`; these override all configuration files.
        """
        found = settings_of.find(Path(path) if path is not None else None)
        return cls(found.root, settings, declared=found.declared)

    def build(
        self,
        recipe: str,
        *targets: str,
        jobs: int | None = None,
        force: Iterable[str] = (),
        keep_going: bool = False,
        whole: bool = False,
        lock: bool = False,
        locked: bool = False,
        listen: Listener | None = None,
        **request: Unpack[RequestArguments],
    ) -> Result:
        """Bring targets of a recipe up to date; only stale nodes run.

        Args:
            recipe: `twin/laptop_scene`, or with a target: `twin/laptop_scene:scene`.
            targets: Names of targets or addresses of nodes; without any, the default targets.
            jobs: Number of cores to use; most nodes take one.
            force: Addresses of nodes to run even if cached.
            keep_going: After a failure, continue with nodes that do not depend on it.
            whole: Also fetch or rebuild the bytes of nodes that no other node reads.
            lock: Pin the targets in dxb.lock.
            locked: Refuse targets that differ from their pins.
            listen: Takes every event as it happens, in the calling thread.
            request: `inputs`, `settings`, `backends`, `profile`: see `RequestArguments`.

        Raises:
            UsageError: A name does not exist.
            RecipeError: A recipe or an input is invalid.
            StaleError: With `locked`, a target differs from its pin.
            MachineError: A chosen backend is not installed.
        """
        here = self._with(profile=request.get("profile"), jobs=jobs)
        session, names = here._open(recipe, targets, request, makes=True)
        order = building.Order(names, keep_going, tuple(force), whole)
        locking = Locking(here, lock=lock, locked=locked, added=session.added)
        built = building.build(session, order, locking, listen or (lambda event: None))
        result = built.result
        paths = {node: Path(path) for node, path in built.placed.paths.items()}
        return Result(result.ok, built.run, result.nodes, result.targets, paths, result.errors, session)

    def plan(self, recipe: str, *targets: str, **request: Unpack[RequestArguments]) -> list[Planned]:
        """The effect of `build` on each node, without running anything; takes the arguments of `build`."""
        from dextera_build.engine.dry import plan as dry

        session, names = self._with(profile=request.get("profile"))._open(recipe, targets, request)
        graph = session.plan().graph
        wanted = [address for name in names for address in addresses(graph, name)]
        return dry(graph, wanted, session.store, history=session.past_builds)

    def why(self, node: str, **request: Unpack[RequestArguments]) -> Why:
        """Why `twin/laptop_scene:body[mug].mesh` is stale, or when it was built; takes the arguments of `build`."""
        from dextera_build.explain.why import explain

        named = parse_target(node)
        session = Session(self._with(profile=request.get("profile")), named.recipe, _added(request))
        sentence, causes = explain(session, named.node)
        return Why(node, sentence, tuple(causes))

    def get(self, node: str, **request: Unpack[RequestArguments]) -> Artifact:
        """The artifact from the last build of `twin/laptop_scene:scene`; nothing runs.

        Takes the arguments of `build`. Without any, a recipe that was never built as it is answers for the request
        that was last built successfully.

        Raises:
            UsageError: The node was never built here.
            RuleError: The node was built, but the store no longer holds its output.
        """
        named = parse_target(node)
        here = self._with(profile=request.get("profile"))
        return Session(here, named.recipe, _added(request), last=True, node=named.node).artifact(named.node)

    def _with(self, **settings: object) -> Project:
        flags = {name: value for name, value in settings.items() if value is not None}
        return Project(self.root, self._flags | flags, declared=self.declared) if flags else self

    def _open(
        self, recipe: str, targets: tuple[str, ...], request: RequestArguments, *, makes: bool = False
    ) -> tuple[Session, list[str]]:
        named = parse_target(recipe)
        session = Session(self, named.recipe, _added(request), makes=makes)
        return session, [*([named.node] if named.node or not targets else []), *targets]


def _added(request: RequestArguments) -> Added:
    if unknown := request.keys() - RequestArguments.__annotations__.keys():
        raise UsageError(
            f"no argument is called `{min(unknown)}`",
            code="DXB-U174",
            facts={"arguments": listing(RequestArguments.__annotations__)},
            hint=did_you_mean(min(unknown), RequestArguments.__annotations__) or "`settings` overrides options",
        )
    return Added(
        {name: os.fspath(path) for name, path in request.get("inputs", {}).items()},
        tuple(f"{name}={_spelled(name, value)}" for name, value in request.get("settings", {}).items()),
        request.get("backends", {}),
    )


def _spelled(name: str, value: object) -> str:
    try:
        # Settings are parsed as YAML, and JSON is valid YAML.
        return json.dumps(value, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the value of `{name}` is not plain data: {error}", code="DXB-U163") from None
