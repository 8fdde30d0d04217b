"""The plan as the engine sees it: calls, groups, inputs. Plain data, made by `recipe.plan`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from dextera_build.errors import Place, UsageError
from dextera_build.workers.capacity import Needs
from dextera_build.workers.retries import Retries


@dataclass(frozen=True, slots=True)
class Leaf:
    """A file or folder of the project; becomes a `File` or `Folder` artifact by its content."""

    path: Path
    where: Place


@dataclass(frozen=True, slots=True)
class Output:
    """What another call returns. `scope` counts the groups between the graph's root and that call.

    `Output(("camera",), ())` is the root call `camera`; inside a copy of group `body`, `Output(("body", "mesh"), ())`
    is the same copy's `mesh`; from outside the group the same address is a `Gather`.
    """

    call: tuple[str, ...]
    fields: tuple[str, ...] = ()
    """Fields of artifact headers to follow: `$capture.rgb`."""


@dataclass(frozen=True, slots=True)
class Item:
    """The item that the enclosing group `group` was opened for."""

    group: tuple[str, ...]
    fields: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Gather:
    """A `Collection` of what every copy of a call returns, by the copies' labels."""

    call: tuple[str, ...]
    fields: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Pack:
    """A `Collection` of inputs that the recipe lists by label."""

    parts: Mapping[str, Leaf | Output | Item | Gather]


@dataclass(frozen=True)
class Fixed:
    """Labels that the recipe itself lists; what a group without a collection is opened for."""

    labels: tuple[str, ...]


Input: TypeAlias = Leaf | Output | Item | Gather | Pack


def parts_of(source: Input) -> tuple[Leaf | Output | Item | Gather, ...]:
    """The input itself, or those that a pack is made of."""
    return tuple(source.parts.values()) if isinstance(source, Pack) else (source,)


_NONE = Retries()


@dataclass(frozen=True)
class RuleFacts:
    """All that the key holds of a rule and its backend; made by the loader."""

    path: str
    """`factorize.mesh`."""
    version: int
    code: Mapping[str, Mapping[str, str]]
    """Source file (`rules/factorize/mesh.py`) -> top-level definition (or `<module>`) -> digest of its AST."""
    packages: Mapping[str, str]
    """Distribution -> version."""
    backend: str | None
    weights: tuple[str, ...]
    types: Mapping[str, str]
    """Slot, or `return` -> schema digest."""
    cpus: int = 1
    memory_gb: float = 1.0
    gpus: int = 0
    gpu_gb: float = 0.0
    named: tuple[tuple[str, float], ...] = ()
    retries: Retries = _NONE
    discovers: str = ""
    """The folder in which calls of it read by themselves, the project's; "" where they do not."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """What a worker compares before it runs the code; `code` is what the key holds of it."""

    @cached_property
    def needs(self) -> Needs:
        """What a call takes of a machine; no part of the key, and neither are retries."""
        return Needs(self.cpus, self.memory_gb, self.gpus, self.gpu_gb, self.named)


@dataclass(frozen=True, slots=True)
class Call:
    """One call of a rule; inside a group it stands for one node per copy."""

    name: str
    rule: RuleFacts
    options: Mapping[str, object]
    """Every option with its value, as plain JSON data."""
    inputs: Mapping[str, Input]
    where: Place
    option_places: Mapping[str, Place] = field(default_factory=dict)
    """Where the recipe (or the command line) sets an option."""
    salt: str = ""


@dataclass(frozen=True)
class Group:
    """Calls that are copied once per item of a collection."""

    name: str
    over: Output | Item | Fixed
    members: Mapping[str, Call | Group]
    overrides: Mapping[str, Mapping[str, Call]]
    """Label -> member -> the call that replaces it in that copy (`body[mug].mesh`)."""
    where: Place


@dataclass(frozen=True)
class Graph:
    """A recipe resolved as far as it can be before anything runs."""

    name: str
    """Recipe address: `twin/laptop_scene`."""
    members: Mapping[str, Call | Group]
    targets: Mapping[str, tuple[tuple[str, ...], ...]]
    """Target name -> call addresses as tuples; `default` is always there."""

    def calls(self) -> Iterator[tuple[tuple[str, ...], Call]]:
        """Every call with its address, groups in order; one after another, because there may be many."""
        stack: list[tuple[tuple[str, ...], Call | Group]] = []
        for first, outer in self.members.items():
            stack.append(((first,), outer))
            while stack:
                address, member = stack.pop()
                if isinstance(member, Call):
                    yield address, member
                else:
                    stack += [((*address, name), inner) for name, inner in reversed(list(member.members.items()))]


@dataclass(frozen=True)
class Plan:
    """The graph, every file that planning read, and the rules of its calls."""

    graph: Graph
    recipes: tuple[Path, ...]
    rules: tuple[RuleFacts, ...]


def node_address(call: tuple[str, ...], labels: tuple[str, ...]) -> str:
    """`body[mug].mesh` from ("body", "mesh") and ("mug",): one label per enclosing group."""
    parts = [f"{name}[{label}]" for name, label in zip(call[:-1], labels, strict=True)]
    return ".".join([*parts, call[-1]])


@dataclass(frozen=True)
class Address:
    """What a target names: a call, and which of its copies."""

    call: tuple[str, ...]
    """Groups from the root, then the call."""
    labels: tuple[str, ...] | None = None
    """Labels of the enclosing groups from the outside in; None or fewer than groups means every copy below."""

    def __str__(self) -> str:
        """`body[mug].mesh`; groups without a label stand bare: `body.mesh`."""
        if not self.labels:
            return ".".join(self.call)
        labels = (*self.labels, *[None] * len(self.call))
        return ".".join(
            f"{name}[{label}]" if label is not None else name for name, label in zip(self.call, labels, strict=False)
        )

    def matches(self, labels: tuple[str, ...]) -> bool:
        """Whether the copy with these labels is one of those that are named."""
        wanted = self.labels or ()
        return labels[: len(wanted)] == wanted


_STEP = re.compile(r"(?P<name>[^\[\].]+)(?:\[(?P<label>[^\[\]]+)\])?(?:\.|$)")


def parse_address(text: str) -> Address:
    """The address that `str(Address)` wrote: `scene`, `body.mesh`, `body[mug].mesh`.

    Raises:
        UsageError: `text` is not of this form, or has a label after a group without one.
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


def _malformed(text: str) -> UsageError:
    return UsageError(
        f"`{text}` is not the address of a node",
        code="DXB-U201",
        facts={"form": "`scene`, `body.mesh` (every copy) or `body[mug].mesh` (one copy)"},
        hint="dxb ls nodes",
    )
