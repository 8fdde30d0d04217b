"""What a run is told before it begins."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """How a run goes, and what is said of it."""

    keep_going: bool = False
    """Go on with what does not depend on a failed node."""
    force: frozenset[str] = frozenset()
    """Addresses (`body[mug].mesh`, or `body.mesh` for every copy) that run although they are cached."""
    only: frozenset[str] | None = None
    """Addresses that may run; a stale node outside fails with a `StaleError`. None: all may."""
    recall: bool = False
    """Nodes whose results came of recorded calls run although they are cached."""
    whole: bool = False
    """Bring or make the bytes of all nodes, also of those that no other node has to read."""
    dry: bool = False
    """Nothing runs; what would is left in `State.STALE`."""
    project: str = ""
    """Folder of the project; workers get it."""
    profile: str = ""
    run: str = ""
    """Id of the run, `0143`."""
    dxb: str = ""
    """Version of dxb."""
    argv: tuple[str, ...] = ()
    variant: str = ""
    """What tells the request from the recipe's own; see `Session.variant`."""
