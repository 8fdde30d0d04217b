"""Further photographs of a scene, from other places than the first one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.spatial.pose import Pose


class Further(Artifact):
    """One of them."""

    file: str
    """Its file in the capture's folder."""
    capture: Capture
    """The photograph with its depth."""
    pose: Annotated[Pose, Frames("camera", "further")] | None = None
    """T_camera_further: its camera in the frame of the first photograph's; None until `align.photographs` finds it."""


class FurtherPhotographs(Artifact):
    """Photographs of a scene besides the first one, from which everything is made."""

    items: tuple[Further, ...] = ()
    """In the order of `capture.json`; empty if there is one photograph only."""

    def facts(self) -> Iterator[str]:
        """Their files."""
        yield ", ".join(one.file for one in self.items) or "one photograph only"
