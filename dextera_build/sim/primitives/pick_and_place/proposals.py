"""Tasks of primitive `pick_and_place` that `dxb new task` proposes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.sim.primitives.proposals import Proposal, Shape, camel


def proposals(label: str, shapes: Mapping[str, Shape]) -> Iterator[Proposal]:
    """Put an object without joints into every container that is large enough."""
    if shapes[label].joints:
        return
    for container, shape in sorted(shapes.items()):
        if container != label and shapes[label].fits_into(shape):
            yield Proposal(f"Place{camel(label)}In{camel(container)}", {"into": container}, holds=True)
