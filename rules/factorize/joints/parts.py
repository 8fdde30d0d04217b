"""The result of a backend of factorize.articulate."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.artifacts.object import Joint, Link, Shape


@dataclass(frozen=True)
class Parts:
    """Links and joints as `Body` has them: geometry in the object frame with every joint at 0, root `base`."""

    links: dict[str, Link]
    joints: tuple[Joint, ...]
    overlap_m: float | None = None
    """Maximum mean penetration of the lid into the base while closing [m]; None if nobody looked."""
    metrics: tuple[tuple[str, float, str], ...] = ()
    """Name, value and unit of each metric in the report."""
    shape: Shape | None = None
    """What was cut, where the backend fitted a shape of its own; the links are in its frame."""
