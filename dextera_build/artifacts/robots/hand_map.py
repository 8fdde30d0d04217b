"""How the hand of an operator maps to a hand of a robot, as far as a recipe states it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.core.value import Value

Side = Literal["", "left", "right"]
"""Hand of an operator; empty: not stated."""
Direction = tuple[float, float, float]


class HandMap(Value):
    """Options of `sim.retarget` that a recipe states; defaults follow from the robot's frames and geometry."""

    side: Side = ""
    """Hand of the operator that moves it."""
    fingers: dict[str, str] = Field(default_factory=dict)
    """Finger as in `geometry.hands.FINGERS` -> role of the fingertip among the robot's `frames`."""
    facing: Direction | None = None
    """Unit direction normal to the palm, outwards, in the frame of the palm."""
    pointing: Direction | None = None
    """Unit direction along the straight fingers, in the frame of the palm."""
    scale: float | None = None
    """Metre of the robot's hand per metre of the operator's."""
