"""The result of a backend of factorize.articulate."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.artifacts.objects.object import Joint, Link, Shape


@dataclass(frozen=True)
class Parts:
    """Links and joints as in `Body`: geometry in the object frame with every joint at 0, root `base`."""

    links: dict[str, Link]
    joints: tuple[Joint, ...]
    overlap_m: float | None = None
    """Maximum mean penetration of the lid into the base while closing [m]; None if not computed."""
    metrics: tuple[tuple[str, float, str], ...] = ()
    """Name, value and unit of each metric in the report."""
    shape: Shape | None = None
    """The shape that was cut, if the backend fitted its own; the links are in its frame."""
