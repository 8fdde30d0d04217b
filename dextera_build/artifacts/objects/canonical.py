"""The canonical frame of an object: its up and front directions, and undetermined choices."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.spatial.pose import Pose, Similarity

Open: TypeAlias = Literal["up", "front"]
"""A choice of the canonical frame that can remain undetermined."""


class SymmetryAxis(Value):
    """An axis about which the shape is rotationally symmetric."""

    axis: tuple[float, float, float]
    """Unit direction in the object's frame."""
    order: int
    """Rotations by 1 / order of a full turn are symmetries; 0: all are."""


class CanonicalFrame(Artifact):
    """Canonical axes of an object: functional up is +z, its front is +x, the origin is at the centre of its base."""

    pose: Annotated[Pose, Frames("canonical", "object")]
    """T_canonical_object, without scale."""
    undecided: tuple[Open, ...] = ()
    """Choices that were not clearly determined; `pose` then has the likeliest one."""
    symmetry: tuple[SymmetryAxis, ...] = ()
    """Rotational symmetries of the shape."""
    up_lead: float | None = None
    """Score of the chosen up direction minus that of the next; None if the method has no scores."""
    front_lead: float | None = None
    """Score of the chosen front minus that of the next; None if the method has no scores."""
    method: str
    """Criteria that decided: `holds, picture`."""

    def motion(self) -> Similarity:
        """The similarity with which `artifacts.similar` transforms a body, asset, or pieces into this frame."""
        return Similarity(parent="object", child="object", matrix=np.array(self.pose.matrix), scale=1.0)
