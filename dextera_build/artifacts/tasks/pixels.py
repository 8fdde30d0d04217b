"""Decoded films: pictures that a learner reads in any order."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.task import View


class Pixels(Artifact):
    """The pictures of a film, decoded. Arrays above 1 MiB are memory-mapped from the store: only what is used is read.

    The pictures are those of the film, but take many times its space.
    """

    episodes: dict[str, Annotated[np.ndarray, Array("* H W 3", "uint8")]]
    """Index -> frames (T, H, W, 3) sRGB of one episode; the keys are those of `Episodes.items`."""
    depth: dict[str, Annotated[np.ndarray, Array("* H W", "uint16")]] = Field(default_factory=dict)
    """Index -> distances (T, H, W) of one episode in counts of `DEPTH_STEP_M`, if the film has depth."""
    camera: Camera | None = None
    """Intrinsics at the size of a frame, if the film has depth."""
    view: View | None = None
    """The camera, at the size of a frame; None: it was not stated."""

    @property
    def width(self) -> int:
        """Width of a frame [px]."""
        return self._size[1]

    @property
    def height(self) -> int:
        """Height of a frame [px]."""
        return self._size[0]

    @property
    def _size(self) -> tuple[int, int]:
        first = next(iter(self.episodes.values()), np.zeros((0, 0, 0, 3), np.uint8))
        return int(first.shape[1]), int(first.shape[2])
