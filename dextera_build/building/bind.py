"""Names of objects in `dxb.lock`, which `dxb bind` and the viewer bind, show and remove.

A name is tried in a build of the node that gives names before it is written, so everything in the file was recognised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.building.lock import changing
from dextera_build.building.values import output_of, raise_errors, run, value
from dextera_build.engine.graph import Call
from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.geometry import pictures
from dextera_build.project import lockfile
from dextera_build.project.project import LOCK, Project
from dextera_build.recipe.addresses import parse_target
from dextera_build.recipe.bindings import PROPERTIES, RULE, Binding, Names
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.engine.run import RunResult
    from dextera_build.runs.events import Listener


@dataclass(frozen=True)
class Named:
    """An object under its name."""

    name: str
    object: str
    """Name that parsing proposed."""
    at_px: tuple[int, int]
    """Column and row of one of its pixels [px]."""
    bound: str
    """Source of the binding: `recipe`, `dxb.lock`, or "" for a proposed name."""


@dataclass(frozen=True)
class Table:
    """The objects of a photograph, and the names that it has no object for."""

    rows: tuple[Named, ...]
    stale: tuple[str, ...]
    """Names in `dxb.lock` with no more than a point on another photograph."""


class Naming:
    """A node that gives names, and its block in `dxb.lock`.

    Args:
        project: The project with the lock file.
        target: A recipe with one such node, of its own or of a recipe that it reads; or the node.

    Raises:
        UsageError: There is no such node, several, or one in a group.
    """

    def __init__(self, project: Project, target: str) -> None:
        self._project = project
        asked = parse_target(target)
        graph = Session(project, asked.recipe).plan().graph
        found = [".".join(path) for path, call in graph.calls() if call.rule.path == RULE]
        chosen = [node for node in found if node == asked.node] if asked.node else found
        if len(chosen) != 1:
            raise UsageError(
                f"`{target}` gives names to objects in {len(chosen) or 'no'} node{'s' * (len(chosen) > 1)}",
                code="DXB-U206",
                facts={"nodes that give names": listing(found, most=30)},
                hint=f"`dxb bind {asked.recipe}:{found[0]}`" if found else f"`{RULE}` gives names; see docs/recipes.md",
            )
        if (chosen[0],) not in dict(graph.calls()):
            raise UsageError(
                f"`{chosen[0]}` is in a group, and names are bound outside groups",
                code="DXB-U207",
                hint="bind by `phrase` or a property in the recipe, or use a recipe of its own for the photograph",
            )
        named = parse_target(chosen[0] if ":" in chosen[0] else f"{asked.recipe}:{chosen[0]}")
        self.recipe, self.node = named.recipe, named.node
        self._inputs: tuple[Photograph, Segmentation] | None = None

    @property
    def address(self) -> str:
        """`twin/laptop_scene:named`: the name of the block."""
        return f"{self.recipe}:{self.node}"

    def prepare(self, listen: Listener) -> RunResult:
        """Build the photograph and the objects that get names."""
        session = self._session({})
        slots = {slot: output_of(self._call(session), slot) for slot in ("photograph", "objects")}
        nodes = {slot: ".".join(source.call) for slot, source in slots.items()}
        result = run(session, tuple(nodes.values()), listen)
        if result.ok:
            values = (value(session, result, nodes[slot], source.fields) for slot, source in slots.items())
            self._inputs = tuple(values)
        return result

    def bind(self, name: str = "", draft: Binding | None = None, *, on: str = "") -> Table:
        """Bind a name, or all names of the recipe, to the recognised objects, and write `dxb.lock`.

        Args:
            name: The name; "" for all.
            draft: A point or properties; None: those of the recipe.
            on: Digest of the photograph that the point was chosen in, if it was chosen in a picture.

        Raises:
            UsageError: The recipe binds the name itself, has no such name, or has another photograph than `on`.
            RuleError: A name fits no object or several, or two names fit the same one.
        """
        photograph, objects = self._ready()
        this = pictures.digest_of(photograph.rgb.pixels)
        if on and on != this:
            raise UsageError(
                f"`{self.recipe}` has another photograph than the view",
                code="DXB-U210",
                hint=f"`dxb build {self.recipe}`, and open the view again",
            )
        locked = self.names()
        tried = {known: now for known, old in locked.items() if (now := _tried(old, this))}
        if name:
            tried[name] = self._draft(name, draft, tried.get(name), this)
        options, named = self._try(tried)
        points = {
            label: pictures.innermost(named.map.labels == number) for number, label in enumerate(named.names, start=1)
        }
        found = {}
        for known, said in options.items():
            if said["at_px"] is None and (not name or name == known):
                at = said["locked"]["at_px"] if said["locked"] else points[known]
                found[known] = Binding((at[0], at[1]), this, _properties(said))
        self._write(lambda now: {**now, **found})
        locked = {**locked, **found}
        points |= {known: binding.at_px for known, binding in locked.items() if known in options and binding.at_px}
        origins = dict.fromkeys(options, "recipe") | {known: LOCK for known in locked if known in options}
        rows = [
            Named(label, own, points[label], origins.get(label, ""))
            for label, own in zip(named.names, objects.names, strict=True)
        ]
        return Table(tuple(rows), tuple(known for known in locked if known not in options))

    def names(self) -> dict[str, Binding]:
        """The names in the block."""
        lock = self._project.lock()
        return dict(lock.names.get(self.address, {})) if lock is not None else {}

    def _draft(self, name: str, draft: Binding | None, locked: Binding | None, this: str) -> Binding:
        own = self._call(self._session({})).options["names"].get(name)  # type: ignore[attr-defined]
        if own is None and draft is None and locked is None:
            raise UsageError(
                f"`{name}` has no point and no property",
                code="DXB-U208",
                facts={"names": listing(self.names())},
                hint=f"`dxb bind {self.address} {name} --phrase WORDS`, or `--at COLUMN,ROW`",
            )
        wanted = draft or locked or Binding()
        if own is None:
            return replace(wanted, photograph=this)
        properties = _properties(own)
        if (draft and own["at_px"]) or (wanted.properties and wanted.properties != properties):
            raise UsageError(
                f"the recipe binds `{name}` in another way",
                code="DXB-U209",
                facts={key: str(value) for key, value in own.items() if value},
                hint=f"change `names` of `{self.address}` in the recipe",
            )
        return Binding(wanted.at_px, this, properties)

    def _try(self, names: Names) -> tuple[Mapping[str, Any], Segmentation]:
        """Build the node with these names: its option `names`, and its output."""
        session = self._session(names)
        options: Any = self._call(session).options["names"]
        result = run(session, (self.node,), lambda event: None)
        raise_errors(result)
        found: Any = session.decoded(self.node, RULE, str(result.nodes[self.node].output))
        return options, found

    def _ready(self) -> tuple[Photograph, Segmentation]:
        if self._inputs is None:
            raise_errors(self.prepare(lambda event: None))
        assert self._inputs is not None
        return self._inputs

    def _session(self, names: Names) -> Session:
        lock = self._project.lock()
        others = lock.names if lock is not None else {}
        return Session(self._project, self.recipe, makes=True, names={**others, self.address: names})

    def _call(self, session: Session) -> Call:
        return dict(session.plan().graph.calls())[(self.node,)]

    def _write(self, change: Callable[[Names], Names]) -> None:
        write(self._project, self.address, change)


def write(project: Project, block: str, change: Callable[[Names], Names]) -> None:
    """Change the names of a block of `dxb.lock`."""
    with changing(project) as lock:
        old = lock.names.get(block, {})
        if (new := change(old)) != old:
            lockfile.write(project.root / LOCK, lockfile.Lock(lock.pins, {**lock.names, block: new}))


def remove(project: Project, target: str, name: str) -> None:
    """Remove a name from `dxb.lock`, also if the recipe is gone.

    Args:
        project: The project with the lock file.
        target: A recipe, or its node that gives names.
        name: The name.

    Raises:
        UsageError: `dxb.lock` does not bind the name.
    """
    lock = project.lock()
    blocks = lock.names if lock is not None else {}
    asked = parse_target(target)
    chosen = [block for block in blocks if block == target or (not asked.node and block.startswith(f"{target}:"))]
    having = [block for block in chosen if name in blocks[block]]
    if len(having) != 1:
        known = sorted({known for block in chosen for known in blocks[block]})
        found = f"binds `{name}` in {len(having)} nodes of" if having else f"does not bind `{name}` in"
        raise UsageError(
            f"{LOCK} {found} `{target}`",
            code="DXB-U211",
            facts={"names": listing(known, most=30), "nodes": listing(chosen or blocks)},
            hint=did_you_mean(name, known) or "name the node: `dxb bind RECIPE:NODE --remove NAME`",
        )
    write(project, having[0], lambda now: {known: binding for known, binding in now.items() if known != name})


def _tried(old: Binding, photograph: str) -> Binding | None:
    """The binding as it counts on a photograph."""
    if old.photograph == photograph:
        return old
    return Binding(properties=old.properties) if old.properties else None


def _properties(said: Mapping[str, Any]) -> dict[str, str]:
    return {key: said[key] for key in PROPERTIES if said[key]}
