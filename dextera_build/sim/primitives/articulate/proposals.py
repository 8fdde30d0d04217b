"""Tasks of primitive `articulate` that `dxb new task` proposes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from dextera_build.sim.primitives.proposals import Proposal, Shape, camel


def proposals(label: str, shapes: Mapping[str, Shape]) -> Iterator[Proposal]:
    """Move each joint to its farther limit; the lower one counts as closed."""
    for joint, (position, lower, upper) in shapes[label].joints.items():
        closes = position - lower > upper - position
        target = np.degrees(lower if closes else upper)
        verb = "Close" if closes else "Open"
        yield Proposal(f"{verb}{camel(label)}", {"joints_deg": f"{{{joint}: {target:.0f}}}"})
