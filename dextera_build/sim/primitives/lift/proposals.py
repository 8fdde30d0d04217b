"""Tasks of primitive `lift` that `dxb new task` proposes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.sim.primitives.proposals import Proposal, Shape, camel


def proposals(label: str, shapes: Mapping[str, Shape]) -> Iterator[Proposal]:
    """Lift an object without joints."""
    if not shapes[label].joints:
        yield Proposal(f"Lift{camel(label)}", {"height_m": "0.10"}, holds=True)
