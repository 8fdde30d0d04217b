"""The graphs that every tool builds, and what comes out of them.

A node adds the first lines of its inputs, times 31, plus its own number, modulo a prime. So a change of one leaf
changes every node that depends on it, a change of a leaf's second line changes none, and one `sh` without a further
process does the work.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

FACTOR, PRIME = 31, 1_000_003
LAYERS = 10


@dataclass(frozen=True)
class Dag:
    """Leaves are files, nodes are steps; nodes stand in an order in which they can run."""

    shape: str
    leaves: dict[str, int]
    """Name -> number in its first line."""
    nodes: dict[str, tuple[str, ...]] = field(repr=False)
    """Name -> names of the leaves and nodes that it reads."""

    @cached_property
    def sinks(self) -> list[str]:
        """Nodes that no other reads."""
        read = {name for inputs in self.nodes.values() for name in inputs}
        return [node for node in self.nodes if node not in read]

    def steps(self) -> Iterator[tuple[int, str, list[str], str]]:
        """(number, name, paths of its inputs, path of its output) of every node, from the project's folder."""
        for number, (node, inputs) in enumerate(self.nodes.items()):
            yield number, node, [place(name) for name in inputs], place(node)

    def reached_from(self, leaf: str) -> int:
        """How many nodes depend on a leaf."""
        reached = {leaf}
        for node, inputs in self.nodes.items():
            if not reached.isdisjoint(inputs):
                reached.add(node)
        return len(reached) - 1


def place(name: str) -> str:
    """Where a leaf or a node's output lies in a project."""
    return f"leaves/{name}" if name.startswith("l") else f"out/{name}"


def evaluate(dag: Dag, leaves: Mapping[str, int]) -> dict[str, int]:
    """What each node must be."""
    values = dict(leaves)
    for number, (node, inputs) in enumerate(dag.nodes.items()):
        values[node] = (sum(values[name] for name in inputs) * FACTOR + number) % PRIME
    return values


def write_leaf(folder: Path, leaf: str, value: int, comment: str = "comment 0") -> None:
    """Write a leaf: its number, and a line that no node reads."""
    (folder / "leaves" / leaf).write_text(f"{value}\n# {comment}\n")


def wide(size: int) -> Dag:
    """Every node reads a leaf of its own."""
    return Dag("wide", {f"l{n}": n for n in range(size)}, {f"n{n}": (f"l{n}",) for n in range(size)})


def chain(size: int) -> Dag:
    """Every node reads the one before."""
    return Dag("chain", {"l0": 0}, {f"n{n}": (f"n{n - 1}" if n else "l0",) for n in range(size)})


def layered(size: int) -> Dag:
    """Ten layers; the first reads leaves, a later node reads up to three of the layer before it."""
    width = max(1, -(-size // LAYERS))
    nodes = {}
    for number in range(size):
        layer, column = divmod(number, width)
        before = [c for c in (column, column ^ 1, column ^ 2) if c < width]
        nodes[f"n{number}"] = tuple(f"n{(layer - 1) * width + c}" for c in before) if layer else (f"l{column}",)
    return Dag("layered", {f"l{n}": n for n in range(min(width, size))}, nodes)


SHAPES = {"wide": wide, "chain": chain, "layered": layered}
