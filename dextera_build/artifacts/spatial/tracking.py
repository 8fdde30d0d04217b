"""Poses and joint positions of several objects over time."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.track import Track
from dextera_build.errors import ArtifactError


class Tracking(Artifact):
    """Tracks of several objects in one frame, at the same times."""

    tracks: dict[str, Track] = Field(min_length=1)
    """Name -> its poses."""
    joints: dict[str, Joints] = Field(default_factory=dict)
    """Name -> positions of its joints at the times of its track; the last known ones while it is lost."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        parents = {track.parent for track in self.tracks.values()}
        counts = {len(track.stamps) for track in self.tracks.values()}
        counts |= {len(each.stamps) for each in self.joints.values()}
        if len(parents) != 1 or len(counts) != 1 or set(self.joints) - set(self.tracks):
            raise ArtifactError(
                "Tracking: its tracks differ in frame or number of times, or joints belong to no track",
                code="DXB-A548",
                facts={"frames": ", ".join(sorted(parents)), "times": ", ".join(map(str, sorted(counts)))},
            )
        return self
