"""The plan as the engine sees it: calls, groups, inputs. Plain data, made by `recipe.plan`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from dextera_build.errors import DxbError, Place, UsageError, did_you_mean, listing
from dextera_build.workers.capacity import Needs
from dextera_build.workers.protocol import Task
from dextera_build.workers.retries import Retries


@dataclass(frozen=True, slots=True)
class Leaf:
    """A file or folder of the project, digested by content into a `File` or `Folder` artifact."""

    path: Path
    where: Place


@dataclass(frozen=True, slots=True)
class Output:
    """The output of another call.

    `Output(("camera",), ())` is the root call `camera`; inside a copy of group `body`, `Output(("body", "mesh"), ())`
    is the same copy's `mesh`; from outside the group the same address is a `Gather`.
    """

    call: tuple[str, ...]
    fields: tuple[str, ...] = ()
    """Fields of artifact headers to follow: `$capture.rgb`."""
    optional: bool = False
    """Whether the reader does without the input if one of `fields` is not set."""


@dataclass(frozen=True, slots=True)
class Item:
    """The current item of the enclosing group `group`."""

    group: tuple[str, ...]
    fields: tuple[str, ...] = ()
    optional: bool = False
    """See `Output.optional`."""


@dataclass(frozen=True, slots=True)
class Gather:
    """A `Collection` of the outputs of every copy of a call, by the copies' labels."""

    call: tuple[str, ...]
    fields: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Pack:
    """A `Collection` of inputs that the recipe lists by label."""

    parts: Mapping[str, Leaf | Output | Item | Gather]


@dataclass(frozen=True)
class Fixed:
    """Labels that the recipe itself lists, for a group without a collection."""

    labels: tuple[str, ...]


OnFailure: TypeAlias = Literal["stop", "go_on", "leave_out"]
"""Effect of a failure: the run stops; it goes on without the node and fails at its end; it goes on and succeeds."""


def mildest(effects: Iterable[OnFailure]) -> OnFailure:
    """The effect that counts if several are said of one failure."""
    return max(effects, key=get_args(OnFailure).index, default="stop")


Names: TypeAlias = tuple[str, ...]
"""Names from the root of the graph: the address of a call or group without labels."""
Input: TypeAlias = Leaf | Output | Item | Gather | Pack


def parts_of(source: Input) -> tuple[Leaf | Output | Item | Gather, ...]:
    """The input itself, or the parts of a pack."""
    return tuple(source.parts.values()) if isinstance(source, Pack) else (source,)


_NONE = Retries()


@dataclass(frozen=True)
class RuleFacts:
    """The part of a key that describes a rule and its backend; made by the loader."""

    path: str
    """`factorize.mesh`."""
    version: int
    code: Mapping[str, Mapping[str, str]]
    """Source file (`rules/factorize/mesh.py`) -> top-level definition (or `<module>`) -> digest of its AST."""
    packages: Mapping[str, str]
    """Distribution -> version."""
    backend: str | None
    weights: tuple[str, ...]
    """`name@digest` of each model."""
    types: Mapping[str, str]
    """Slot, or `return` -> schema digest."""
    cpus: int = 1
    memory_gb: float = 1.0
    gpus: int = 0
    gpu_gb: float = 0.0
    named: tuple[tuple[str, float], ...] = ()
    retries: Retries = _NONE
    discovers: str = ""
    """The project folder if the rule discovers inputs there; "" otherwise."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Source digests that a worker checks before it runs the code; the key holds `code` instead."""

    program: Mapping[str, str] = field(default_factory=dict)
    """File of the backend's program, or lock file of its environment -> digest of its bytes; `code` holds them, too."""
    companions: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Slot -> files that run its artifact: `learn.act/policy` next to the rule that made it, `primitives/lift/script`
    in a folder that the maker's option names; option -> files in the folder that it names. `code` holds them."""

    chosen: str = ""
    """Origin of the backend, and skipped backends; not part of the key, like the rest below."""
    passed: tuple[str, ...] = ()
    """Preferred backends that this machine cannot run."""
    missing: tuple[str, ...] = ()
    """Requirements of the backend that this machine lacks."""
    hint: str | None = None
    """The next step if something is missing."""

    def task(self, options: Mapping[str, object], inputs: Mapping[str, str], **of_run: Any) -> Task:
        """A run of it with these inputs, slot -> digest; `of_run` are the other fields of the task."""
        return Task(
            rule=self.path,
            backend=self.backend,
            options=options,
            inputs=inputs,
            needs=self.needs,
            sources=self.sources,
            packages=self.packages,
            weights=self.weights,
            program=self.program,
            companions=self.companions,
            **of_run,
        )

    @cached_property
    def needs(self) -> Needs:
        """Resources that a call needs; not part of the key, and neither are retries."""
        return Needs(self.cpus, self.memory_gb, self.gpus, self.gpu_gb, self.named)


@dataclass(frozen=True, slots=True)
class Call:
    """One call of a rule; inside a group, it becomes one node per copy."""

    name: str
    rule: RuleFacts
    options: Mapping[str, object]
    """Every option with its value, as plain JSON data."""
    inputs: Mapping[str, Input]
    where: Place
    option_places: Mapping[str, Place] = field(default_factory=dict)
    """Where the recipe (or the command line) sets an option."""
    salt: str = ""
    on_failure: OnFailure = "stop"

    def leaves(self) -> Iterator[Leaf]:
        """Every file and folder that the call reads."""
        for source in self.inputs.values():
            yield from (part for part in parts_of(source) if isinstance(part, Leaf))

    def files(self) -> dict[str, Path]:
        """Slot -> path for each file or folder; `slot[label]` if a slot lists several."""
        found = {}
        for slot, source in self.inputs.items():
            parts = source.parts if isinstance(source, Pack) else {"": source}
            for label, part in parts.items():
                if isinstance(part, Leaf):
                    found[f"{slot}[{label}]" if label else slot] = part.path
        return found

    def placed(self, where: Place | None, project: str) -> Place | None:
        """The place of an error of the rule; a rule knows the file of an input only as `$slot`.

        A path below the folder `project` becomes relative to it.
        """
        path = None if where is None else self.files().get(where.file.removeprefix("$"))
        if where is None or path is None or not where.file.startswith("$"):
            return where
        return replace(where, file=str(path.relative_to(project) if path.is_relative_to(project) else path))


@dataclass(frozen=True)
class Group:
    """Calls that are copied once per item of a collection."""

    name: str
    over: Output | Item | Fixed
    members: Mapping[str, Call | Group]
    overrides: Mapping[str, Mapping[str, Call]]
    """Label -> member -> the call that replaces it in that copy (`body[mug].mesh`)."""
    where: Place
    on_failure: OnFailure = "stop"
    """Effect of a copy that fails; collections do without it unless this is `stop`."""
    named: Mapping[str, str] = field(default_factory=dict)
    """Label of a copy that must exist -> the text of the request that names it."""


@dataclass(frozen=True)
class Graph:
    """A recipe, resolved as far as possible before anything runs."""

    name: str
    """Recipe address: `twin/laptop_scene`."""
    members: Mapping[str, Call | Group]
    targets: Mapping[str, tuple[tuple[str, ...], ...]]
    """Target name -> call addresses as tuples; `default` always exists."""

    def calls(self) -> Iterator[tuple[tuple[str, ...], Call]]:
        """Yield every call with its address, groups in order."""
        stack: list[tuple[tuple[str, ...], Call | Group]] = []
        for first, outer in self.members.items():
            stack.append(((first,), outer))
            while stack:
                address, member = stack.pop()
                if isinstance(member, Call):
                    yield address, member
                else:
                    stack += [((*address, name), inner) for name, inner in reversed(list(member.members.items()))]

    def rules(self) -> tuple[RuleFacts, ...]:
        """The rules of all calls, replacements in copies included, each once."""
        found: dict[int, RuleFacts] = {}
        for path, _ in self.calls():
            found |= {id(call.rule): call.rule for call in self.variants(path)}
        return tuple(found.values())

    def group(self, path: Names) -> Group:
        """The group at `path`."""
        members = self.members
        for name in path[:-1]:
            outer = members[name]
            assert isinstance(outer, Group), f"{path} leads through a call"
            members = outer.members
        group = members[path[-1]]
        assert isinstance(group, Group), f"{path} is a call"
        return group

    def is_lenient(self, path: Names, outside: int = 0) -> bool:
        """Whether a group around the call or group at `path` is lenient, not counting the `outside` outermost ones."""
        return any(self.group(path[:depth]).on_failure != "stop" for depth in range(outside + 1, len(path)))

    def copy(self, path: Names, labels: tuple[str, ...] = ()) -> Call:
        """The call at `path`, or its replacement in the copy with these labels."""
        inner, call = self._call(path)
        return inner.overrides.get(labels[-1], {}).get(call.name, call) if inner and labels else call

    def variants(self, path: Names) -> list[Call]:
        """The call at `path` and its replacements in copies of its group."""
        inner, call = self._call(path)
        replaced = inner.overrides.values() if inner else ()
        return [call, *(members[call.name] for members in replaced if call.name in members)]

    def needs(self, path: Names) -> Iterator[Names]:
        """The calls that any copy of the call at `path` reads, and those whose collections its groups open over."""
        inputs = [given for call in self.variants(path) for given in call.inputs.values()]
        over = [self.group(path[:depth]).over for depth in range(1, len(path))]
        for source in (*over, *(part for given in inputs for part in parts_of(given))):
            if isinstance(source, Output | Gather):
                yield source.call

    def walk(self, targets: Sequence[Address]) -> Iterator[Names]:
        """The address of every call that `targets` may need, in order of discovery.

        Raises:
            UsageError: A target names a copy that its group does not have.
        """
        for target in targets:
            self._refuse_unknown(target)
        seen: set[Names | str] = set()
        stack = [target.call for target in reversed(targets)]
        while stack:
            path = stack.pop()
            name = path if len(path) > 1 else path[0]  # most calls are at the root; saves a tuple each
            if name not in seen:
                seen.add(name)
                stack += self.needs(path)
                yield path

    def _call(self, path: Names) -> tuple[Group | None, Call]:
        """The call at `path` and its innermost group."""
        inner = self.group(path[:-1]) if len(path) > 1 else None
        call = (inner.members if inner else self.members)[path[-1]]
        assert isinstance(call, Call), f"{path} is a group"
        return inner, call

    def _refuse_unknown(self, target: Address) -> None:
        """Refuse a copy that is missing from a group with fixed labels."""
        labels = target.labels or ()
        for depth, label in enumerate(labels):
            over, path = self.group(target.call[: depth + 1]).over, target.call[: depth + 1]
            if isinstance(over, Fixed) and label not in over.labels:
                raise no_copy(str(target), node_address(path, labels[:depth]), label, over.labels)


@dataclass(frozen=True)
class Plan:
    """The graph, the recipe files that planning read, and the rules of its calls."""

    graph: Graph
    recipes: tuple[Path, ...]
    rules: tuple[RuleFacts, ...]
    absent: tuple[DxbError, ...] = ()
    """An error for each required input that is not given or not there; without them, nothing is looked up or run."""
    kinds: Mapping[str, str] = field(default_factory=dict)
    """Path that an input names or might name -> `File`, `Folder`, or "" if nothing was there."""


def node_address(call: tuple[str, ...], labels: tuple[str, ...]) -> str:
    """`body[mug].mesh` from ("body", "mesh") and ("mug",): one label per enclosing group."""
    parts = [f"{name}[{label}]" for name, label in zip(call[:-1], labels, strict=True)]
    return ".".join([*parts, call[-1]])


@dataclass(frozen=True)
class Address:
    """The call that a target names, and optionally which of its copies."""

    call: tuple[str, ...]
    """Groups from the root, then the call."""
    labels: tuple[str, ...] | None = None
    """Labels of the enclosing groups, outermost first; None, or fewer labels than groups, means every copy below."""

    def __str__(self) -> str:
        """`body[mug].mesh`; groups without a label have no brackets: `body.mesh`."""
        if not self.labels:
            return ".".join(self.call)
        labels = (*self.labels, *[None] * len(self.call))
        return ".".join(
            f"{name}[{label}]" if label is not None else name for name, label in zip(self.call, labels, strict=False)
        )

    def matches(self, labels: tuple[str, ...]) -> bool:
        """Whether the address includes the copy with these labels."""
        wanted = self.labels or ()
        return labels[: len(wanted)] == wanted


_STEP = re.compile(r"(?P<name>[^\[\].]+)(?:\[(?P<label>[^\[\]]+)\])?(?:\.|$)")


def parse_address(text: str) -> Address:
    """Parse an address as `str(Address)` writes it: `scene`, `body.mesh`, `body[mug].mesh`.

    Raises:
        UsageError: `text` is malformed, or has a label after a group without one.
    """
    names: list[str] = []
    labels: list[str] = []
    place, bare = 0, False
    while place < len(text):
        step = _STEP.match(text, place)
        if step is None:
            raise _malformed(text)
        place = step.end()
        names.append(step["name"])
        if step["label"] is not None:
            if bare:
                raise _malformed(text)
            labels.append(step["label"])
        bare = step["label"] is None
    if not names or not bare or text.endswith("."):
        raise _malformed(text)
    return Address(tuple(names), tuple(labels) or None)


def no_copy(target: str, group: str, label: str, known: Iterable[str]) -> UsageError:
    """The error for a `target` that names a copy `group` does not have."""
    return UsageError(
        f"`{target}`: there is no `{label}` in `{group}`",
        code="DXB-U203",
        facts={"copies": listing(known)},
        hint=did_you_mean(label, known),
    )


def _malformed(text: str) -> UsageError:
    return UsageError(
        f"`{text}` is not the address of a node",
        code="DXB-U201",
        facts={"form": "`scene`, `body.mesh` (every copy) or `body[mug].mesh` (one copy)"},
        hint="dxb ls nodes",
    )
