"""`dxb.lock` during a build: refuses targets that differ from it, or keeps it up to date."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dextera_build.errors import StaleError, UsageError
from dextera_build.project.project import LOCK

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.graph import Address
    from dextera_build.engine.run import RunResult
    from dextera_build.explain.causes import Cause, Causes
    from dextera_build.project.lockfile import Lock, Name, Pin, Pins
    from dextera_build.project.planning import Added
    from dextera_build.project.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.session import Session
    from dextera_build.store.store import Store


class Locking:
    """The lock file during one command.

    `--lock` pins the built targets, `--locked` refuses targets that differ. Without either, the pins of an existing
    lock file are updated, and none is added. A build with `--input` changes pins only with `--lock`; one with `--set`
    or `--backend` is never pinned.

    Args:
        project: The project with the lock file.
        lock: Pin the built targets.
        locked: Refuse targets that differ.
        added: The request's additions to the recipes.

    Raises:
        UsageError: The arguments cannot be combined.
        RecipeError: The lock file is not valid.
    """

    def __init__(self, project: Project, *, lock: bool, locked: bool, added: Added) -> None:
        self._project, self._plain = project, not added
        self._given = "".join(f" --input {name}={value}" for name, value in added.inputs.items())
        self.lock, self.locked = lock, locked
        self.path = project.root / LOCK
        if lock and locked:
            raise UsageError("`--lock` and `--locked` do not go together", code="DXB-U160", hint="give one of them")
        if (lock or locked) and (added.settings or added.backends):
            raise UsageError(
                "a build with `--set` or `--backend` cannot be pinned",
                code="DXB-U161",
                hint="write it into a recipe, which can extend this one, and lock that",
            )
        pins = self._pins() if self._plain or lock or locked else None
        self._exists = pins is not None
        self._old = pins or {}
        self._new: dict[Name, Pin | None] = {}
        """New pins of this command; None drops a pin."""

    def refuse(self, session: Session, plan: Plan, wanted: Sequence[Address]) -> None:
        """With `--locked`, refuse targets known to differ: before anything runs, and again when all keys are known.

        Raises:
            StaleError: A target is not pinned, or has another key or output.
        """
        if not self.locked:
            return
        from dextera_build.engine.dry import plan as dry
        from dextera_build.explain.causes import Causes

        states = {node.address: node for node in dry(plan.graph, wanted, session.store)}
        asked = {name: node for name, node in states.items() if _is_asked(name, wanted)}
        causes = Causes(session, plan.graph, states)
        told = {name: self._difference(session.recipe, node, causes) for name, node in asked.items()}
        if not any(_is_open(node) for node in asked.values()):
            gone = [name.node for name in self._old if self._is_of(name, session.recipe) and name.node not in asked]
            told |= {node: "pinned, but not there any more" for node in gone if _is_asked(node, wanted)}
        facts = {name: difference for name, difference in told.items() if difference}
        if facts:
            raise StaleError(
                f"`{session.recipe}` does not match `{self.path.name}`",
                code="DXB-C103",
                facts=facts,
                hint=f"`dxb build --lock {session.recipe}{self._given}` pins the current one",
            )

    def _difference(self, recipe: str, state: Planned, causes: Causes) -> str:
        pin = self._old.get(self._name(recipe, state.address))
        if pin is None:
            return "" if _is_open(state) else "not pinned"
        if state.key is None and state.key_document:
            # Discovered inputs: the store may know which files the pinned node read; otherwise the build decides.
            found = causes.since(state.address, pin.key)
            known = not any(cause.kind == "lost" for cause in found)
            return "\n".join([f"key {pin.key[:12]} -> ?", *map(_line, found)]) if found and known else ""
        if state.key not in (None, pin.key):
            lines = [_line(cause) for cause in causes.since(state.address, pin.key)]
            return "\n".join([f"key {pin.key[:12]} -> {(state.key or '')[:12]}", *lines])
        if state.output not in (None, pin.output):
            return f"key {pin.key[:12]} as pinned, output {pin.output[:12]} -> {(state.output or '')[:12]}"
        return ""

    def note(self, session: Session, plan: Plan, wanted: Sequence[Address], result: RunResult) -> None:
        """Collect the pins of the built targets; drop the pins of targets that no longer exist."""
        if self.locked or not (self.lock or (self._plain and self._exists)):
            return
        from dextera_build.project.lockfile import Pin

        for node in result.targets:
            name, record = self._name(session.recipe, node), result.nodes[node]
            if (self.lock or name in self._old) and record.key and record.output:
                self._new[name] = Pin(record.key, record.output, _size(session.store, record.key))
        from dextera_build.engine.graph import parse_address

        others = [name for name in self._old if self._is_of(name, session.recipe) and name.node not in result.targets]
        calls = {call for call, _ in plan.graph.calls()} if others else set()
        for name in others:
            gone = parse_address(name.node).call not in calls or _is_asked(name.node, wanted)
            self._new |= {name: None} if gone else {}

    def write(self) -> str:
        """Update the file if anything changed; returns a line that describes the changes, or ""."""
        if self.locked or not (self.lock or self._new):
            return ""
        from dextera_build.project import lockfile

        with changing(self._project) as lock:
            # Another build may have written in the meantime; its pins stay.
            now = lock.pins
            pins = {name: pin for name, pin in {**now, **self._new}.items() if pin is not None}
            recipes = {address for address, _ in self._project.recipes()}
            gone = [name for name in pins if self.lock and name.recipe not in recipes]
            kept = {name: pin for name, pin in pins.items() if name not in gone}
            written = lockfile.write(self.path, lockfile.Lock(kept, lock.names))
        self._old, self._new = kept, {}
        return f"{self.path.name}: {_told(now, kept, gone)}" if written else ""

    def _pins(self) -> Pins | None:
        """The pins; None if the file does not exist, or has only names, so that no pins are kept."""
        lock = self._project.lock()
        return lock.pins if lock is not None and (lock.pins or not lock.names) else None

    def _name(self, recipe: str, node: str) -> Name:
        from dextera_build.project.lockfile import Name

        return Name(self._project.profile, recipe, node)

    def _is_of(self, name: Name, recipe: str) -> bool:
        return (name.profile, name.recipe) == (self._project.profile, recipe)


@contextlib.contextmanager
def changing(project: Project) -> Iterator[Lock]:
    """The content of `dxb.lock`, while no other command may change it."""
    from dextera_build import digest
    from dextera_build.project.lockfile import Lock
    from dextera_build.store.store import Store

    guard = digest.of_bytes(str(project.root / LOCK).encode())
    with Store(project.cache).locks.hold(guard):
        yield project.lock() or Lock()


def _line(cause: Cause) -> str:
    cells = (cause.kind, cause.name, cause.change, cause.place)
    return "  " * (cause.depth + 1) + "  ".join(cell for cell in cells if cell)


def _is_open(state: Planned) -> bool:
    """Whether the entry represents copies that are not known yet."""
    from dextera_build.engine.graph import parse_address

    address = parse_address(state.address)
    return len(address.call) - 1 > len(address.labels or ())


def _is_asked(node: str, wanted: Sequence[Address]) -> bool:
    from dextera_build.engine.graph import parse_address

    address = parse_address(node)
    return any(address.call == want.call and want.matches(address.labels or ()) for want in wanted)


def _size(store: Store, key: str) -> int:
    entry = store.actions.entry(key)
    assert entry is not None, "a result that was built has an entry"
    return sum(store.blobs.size(blob) or 0 for blob in {entry.result.output, *entry.refers})


def _told(before: Pins, after: Pins, gone: Sequence[Name]) -> str:
    from dextera_build.report.wording import count, some

    fresh = sum(before.get(name) != pin for name, pin in after.items())
    told = [f"{count(fresh, 'target')} pinned"] if fresh else []
    lost = [name for name in before if name not in after]
    told += [f"{count(len(lost), 'pin')} dropped: {some(map(str, lost))}"] if lost else []
    told += ["recipes that are gone"] if gone and len(gone) == len(lost) else []
    return ", ".join(told) or "empty"
