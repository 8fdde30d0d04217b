"""Random graphs with groups, groups in groups, and random edits of them."""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path
from typing import Any

from dextera_build.engine.graph import Address, Call, Fixed, Graph, Group, Input, Output, Pack
from tests.engine.tiny import call, every, facts, graph, group, item, leaf, out

_DOES = ("hash", "hash", "hash", "pick", "const", "blob")


class RandomGraph:
    """A graph that can be edited; equal seeds give equal graphs.

    Args:
        seed: Of the generator.
        folder: Where the files lie that the graph reads.
        wild: Read a folder, too, and call a rule whose output its key does not tell.
        reads: Call a rule that finds out for itself what it reads.
    """

    def __init__(self, seed: int, folder: Path, *, wild: bool = False, reads: bool = False) -> None:
        self.random = random.Random(seed)
        self.files = [folder / f"leaf{n}" for n in range(3)]
        for number, path in enumerate(self.files):
            path.write_text(f"content {number}")
        self.tree = folder / "tree" if wild else None
        self._does = (*_DOES, *(("dice", "dice") if wild else ()), *(("read",) if reads else ()))
        if self.tree is not None:
            self.plant("a", "content 0")
        self._broken: list[tuple[tuple[str, ...], str]] = []
        self.members: dict[str, Call | Group] = {}
        self.folder = folder
        self._grow()

    def graph(self) -> Graph:
        """The graph as it is now."""
        return graph(*self.members.values())

    def targets(self) -> list[Address]:
        """A few calls, at random."""
        paths = [path for path, _ in self.graph().calls()]
        return [Address(path) for path in self.random.sample(paths, min(len(paths), self.random.randint(1, 3)))]

    def edit(self) -> None:
        """Change one thing that may matter."""
        if self.random.random() < 0.3:
            path = self.random.choice([*self.files, self.folder / "leaf3"])  # the last is no input, and may be missing
            number = self.random.randint(0, 2)
            if path not in self.files and path.exists():
                path.unlink()
            else:
                path.write_text(f"content {number} of {path.name}{'.' * number}")
            return
        self._change(self.random.choice([path for path, _ in self.graph().calls()]))

    def break_one(self) -> None:
        """Let one call fail."""
        kept = ("items", "labels", "fail")
        found = [(path, call.options["do"]) for path, call in self.graph().calls() if call.options["do"] not in kept]
        if found:
            self._broken.append(self.random.choice(found))
            self._replace(self._broken[-1][0], lambda old: _with(old, do="fail"))

    def forgive(self) -> None:
        """Let about two thirds of all groups and calls not stop the run when they fail."""
        self.members = {name: self._forgiven(member) for name, member in self.members.items()}

    def _forgiven(self, member: Call | Group) -> Call | Group:
        if isinstance(member, Call):
            return dataclasses.replace(member, on_failure=self.random.choice(("stop", "go_on", "go_on")))
        members = {name: self._forgiven(inner) for name, inner in member.members.items()}
        effect = self.random.choice(("stop", "go_on", "leave_out"))
        return dataclasses.replace(member, members=members, on_failure=effect)

    def mend(self) -> None:
        """Let every call that was broken do what it did."""
        for path, do in self._broken:
            self._replace(path, lambda old, do=do: _with(old, do=do))
        self._broken.clear()

    def plant(self, name: str, text: str | None) -> None:
        """Write a file below the folder that the graph reads, or remove it."""
        assert self.tree is not None
        path = self.tree / name
        if text is None:
            path.unlink(missing_ok=True)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    def _change(self, path: tuple[str, ...]) -> None:
        kind = self.random.randrange(4)
        if kind == 0:
            version = self.random.randint(1, 3)
            self._replace(path, lambda old: dataclasses.replace(old, rule=facts(version, discovers=old.rule.discovers)))
        elif kind == 1:
            digest = str(self.random.randint(1, 3))
            self._replace(
                path,
                lambda old: dataclasses.replace(
                    old, rule=facts(code={"a.py": {"f": digest}}, discovers=old.rule.discovers)
                ),
            )
        elif kind == 2 and len(path) > 1:
            self._override(path)
        else:
            value = self.random.randint(0, 3)
            labels = self.random.sample("pqrs", self.random.randint(0, 3))
            items = {label: f"text {self.random.randint(0, 2)}" for label in labels}
            self._replace(path, lambda old: _with(old, value=items if old.options["do"] == "items" else value))

    def _override(self, path: tuple[str, ...]) -> None:
        label = self.random.choice(["p", "q", "r", "s", "i0", "i1"])
        outer = self.members[path[0]]
        assert isinstance(outer, Group)
        chain = [outer]
        for name in path[1:-1]:
            inner = chain[-1].members[name]
            assert isinstance(inner, Group)
            chain.append(inner)
        old = chain[-1].members[path[-1]]
        assert isinstance(old, Call)
        if old.options["do"] in ("items", "labels"):
            return
        overrides = {name: dict(calls) for name, calls in chain[-1].overrides.items()}
        overrides.setdefault(label, {})[path[-1]] = _with(old, value=f"own {self.random.randint(0, 1)}")
        changed = dataclasses.replace(chain[-1], overrides=overrides)
        self._put(path[:-1], changed)

    def _replace(self, path: tuple[str, ...], change: Any) -> None:
        member: Any = self.members[path[0]]
        for name in path[1:]:
            member = member.members[name]
        self._put(path, change(member))

    def _put(self, path: tuple[str, ...], new: Call | Group) -> None:
        above: list[Any] = [self.members[path[0]]] if len(path) > 1 else []
        for name in path[1:-1]:
            above.append(above[-1].members[name])
        for name, owner in zip(reversed(path[1:]), reversed(above), strict=True):
            new = dataclasses.replace(owner, members={**owner.members, name: new})
        self.members[path[0]] = new

    def _grow(self) -> None:
        pool: list[Input] = [leaf(path) for path in (*self.files, *([self.tree] if self.tree else []))]
        for number in range(self.random.randint(2, 12)):
            kind = self.random.random() if number else 1.0
            if kind < 0.3:
                self._grow_group(f"g{number}", pool)
            elif kind < 0.45:
                self._grow_matrix(f"x{number}", pool)
            else:
                name = f"n{number}"
                self.members[name] = self._call(name, self.random.choice(self._does), pool)
                pool.append(out(name))

    def _grow_matrix(self, name: str, pool: list[Input]) -> None:
        first = self._call("first", self.random.choice(self._does), pool)
        second = self._call("second", self.random.choice(self._does), [*pool, out(f"{name}.first")])
        labels = self.random.sample("pqrs", self.random.randint(1, 3))
        own = {label: _with(first, value=f"own {label}") for label in labels}
        self.members[name] = group(name, Fixed(tuple(labels)), first, second, **own)
        pool += [every(f"{name}.first"), every(f"{name}.second")]

    def _grow_group(self, name: str, pool: list[Input]) -> None:
        source = f"{name}s"
        self.members[source] = self._source(source, pool)
        inside: list[Input] = [*pool, out(source), item(name), item(name)]
        members: list[Call | Group] = []
        gathered: list[Input] = []
        for number in range(self.random.randint(1, 3)):
            member = f"m{number}"
            if number and self.random.random() < 0.4:
                members += self._nested(name, member, inside, gathered)
            else:
                members.append(self._call(member, self.random.choice(self._does), inside))
                inside.append(out(f"{name}.{member}"))
                gathered.append(every(f"{name}.{member}"))
        self.members[name] = group(name, out(source), *members)
        pool += [out(source), *gathered]

    def _nested(self, name: str, member: str, inside: list[Input], gathered: list[Input]) -> list[Call | Group]:
        source = self._source(f"{member}s", inside)
        path = f"{name}.{member}"
        deepest = self._call("deep", self.random.choice(self._does), [*inside, item(path), item(path), item(name)])
        over = Output((name, source.name))
        inside += [every(f"{path}.deep"), out(f"{name}.{source.name}")]
        gathered.append(every(f"{path}.deep"))
        return [source, group(member, over, deepest)]

    def _source(self, name: str, pool: list[Input]) -> Call:
        if self.random.random() < 0.5:
            return self._call(name, "labels", pool)
        labels = self.random.sample("pqrs", self.random.randint(0, 3))
        return call(name, "items", {label: f"text {self.random.randint(0, 2)}" for label in labels})

    def _call(self, name: str, do: str, pool: list[Input]) -> Call:
        count = self.random.randint(0, min(3, len(pool)))
        inputs = {f"s{place}": source for place, source in enumerate(self.random.sample(pool, count))}
        if pool and self.random.random() < 0.25:
            listed = self.random.sample(pool, self.random.randint(1, min(3, len(pool))))
            inputs["listed"] = Pack({f"i{place}": source for place, source in enumerate(listed)})
        value = self.random.randint(0, 3)
        if do != "read":
            return dataclasses.replace(call(name, do, value), inputs=inputs)
        rule = facts(discovers=str(self.folder))
        return dataclasses.replace(call(name, do, {"folder": str(self.folder), "start": value}, rule), inputs=inputs)


def _with(old: Call, **options: Any) -> Call:
    if old.rule.discovers and "value" in options:
        options["value"] = {**old.options["value"], "start": options["value"]}  # type: ignore[dict-item]
    return dataclasses.replace(old, options={**old.options, **options})
