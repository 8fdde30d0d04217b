"""Settings of one run, fixed before it begins."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunPolicy:
    """How a run behaves, and how it is described in its log."""

    keep_going: bool = False
    """Continue with nodes that do not depend on a failed one."""
    force: frozenset[str] = frozenset()
    """Addresses (`body[mug].mesh`, or `body.mesh` for every copy) to run even if cached."""
    only: frozenset[str] | None = None
    """Addresses that may run; any other stale node fails with a `StaleError`. None allows all."""
    recall: bool = False
    """Nodes whose results used recorded calls run even if cached."""
    whole: bool = False
    """Fetch or rebuild the bytes of all nodes, including those that no other node reads."""
    dry: bool = False
    """Nothing runs; nodes that would run stay in `State.STALE`."""
    project: str = ""
    """Project folder, passed to workers."""
    workspace: str = ""
    """The project's name in the history."""
    profile: str = ""
    run: str = ""
    """Id of the run, `0143`."""
    dxb: str = ""
    """Version of dxb."""
    argv: tuple[str, ...] = ()
    variant: str = ""
    """Distinguishes the request from the recipe's default; see `Session.variant`."""
