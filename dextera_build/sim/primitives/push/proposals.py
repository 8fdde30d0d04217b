"""Tasks of primitive `push` that `dxb new task` proposes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.sim.primitives.proposals import Proposal, Shape, camel

FLAT = 1.5
"""Ratio of height and width below which an object is pushed without tipping over."""


def proposals(label: str, shapes: Mapping[str, Shape]) -> Iterator[Proposal]:
    """Push a flat object without joints."""
    x, y, z = shapes[label].size_m.tolist()
    if not shapes[label].joints and z < FLAT * min(x, y):
        yield Proposal(f"Push{camel(label)}", {"by_m": "[0.10, 0.0]"})
