"""The frame in which an object is described: which way up it stands, where its front is, and what stays open."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.frames import Frames
from dextera_build.artifacts.pose import Pose, Similarity

Open: TypeAlias = Literal["up", "front"]
"""A choice of the canonical frame."""


class SymmetryAxis(Value):
    """An axis about which the shape is rotationally symmetric."""

    axis: tuple[float, float, float]
    """Unit direction in the object's frame."""
    order: int
    """Turns by one over this part of a circle are symmetries; 0: every turn is."""


class CanonicalFrame(Artifact):
    """Canonical axes of an object: functional up is +z, its front is +x, the origin is in the middle of its base."""

    type_version: ClassVar[int] = 1

    pose: Annotated[Pose, Frames("canonical", "object")]
    """T_canonical_object, without scale."""
    undecided: tuple[Open, ...] = ()
    """What nothing told clearly; `pose` then has the likeliest choice."""
    symmetry: tuple[SymmetryAxis, ...] = ()
    """Rotational symmetries of the shape."""
    up_lead: float | None = None
    """Score of the chosen up minus that of the next; None if the method gives no scores."""
    front_lead: float | None = None
    """Score of the chosen front minus that of the next; None if the method gives no scores."""
    method: str
    """What decided: `holds, picture`."""

    def motion(self) -> Similarity:
        """What `artifacts.similar` applies to body, asset, or pieces to bring them into this frame."""
        return Similarity(parent="object", child="object", matrix=np.array(self.pose.matrix), scale=1.0)
