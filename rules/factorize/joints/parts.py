"""The result of a backend of factorize.articulate."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.artifacts.object import Joint, Link


@dataclass(frozen=True)
class Parts:
    """Two links and their hinge, with all geometry closed (joint position 0), object frame."""

    base: Link
    lid: Link
    joint: Joint
    overlap_m: float = 0.0
    """Maximum mean penetration of the lid into the base while closing [m]."""
    metrics: tuple[tuple[str, float, str], ...] = ()
    """Name, value and unit of each metric in the report."""
