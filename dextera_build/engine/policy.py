"""What the scheduler is told before a run, and whom it tells during one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dextera_build.engine.units import Node, Opening, Unit
from dextera_build.errors import DxbError


@dataclass(frozen=True)
class Policy:
    """How a run goes."""

    keep_going: bool = False
    """Go on with what does not depend on a failed node."""
    force: frozenset[str] = frozenset()
    """Addresses, with labels or without, that run although they are cached."""
    only: frozenset[str] | None = None
    """Addresses that may run; a stale node outside fails. None: all may."""
    recall: bool = False
    """Nodes whose results came of recorded calls run although they are cached."""
    whole: bool = False
    """Also nodes that no other node has to read shall have their bytes."""
    dry: bool = False
    """Nothing runs; what would is left in `State.STALE`."""
    project: str = ""
    profile: str = ""
    peak_gb: Callable[[str], float | None] = lambda address: None
    """Memory that a node took the last time [GiB], where that is known."""


@dataclass
class Hooks:
    """What the scheduler tells; `execute` makes events of it."""

    sized: Callable[[int, int], None] = lambda nodes, unopened: None
    """So many nodes are needed, and so many groups are not open yet."""
    opened: Callable[[Opening], None] = lambda unit: None
    missed: Callable[[Node, Unit], None] = lambda unit, reader: None
    """The bytes of a node are absent, and a reader needs them, or a target asks for them."""
    started: Callable[[Node], None] = lambda unit: None
    said: Callable[[Node, str, Any], None] = lambda unit, kind, data: None
    settled: Callable[[Node], None] = lambda unit: None
    """A node is done or failed."""
    broken: Callable[[Unit, DxbError], None] = lambda unit, error: None
    """A group cannot be opened, or a collection not be gathered."""
    pause: Callable[[], None] = lambda: None
    """Now time passes: what was told so far is all that there is to tell."""
