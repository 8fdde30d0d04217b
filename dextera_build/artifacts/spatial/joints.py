"""Joint states of a robot over time."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.errors import ArtifactError


class Joints(Artifact):
    """Joint states over time."""

    names: tuple[str, ...]
    """Joints, in the order of the columns."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times."""
    positions: Annotated[np.ndarray, Array("N J", "float64", unit="rad")]
    """Positions [rad], of prismatic joints [m]."""
    velocities: Annotated[np.ndarray, Array("N J", "float64", unit="rad/s")] | None = None
    """Speeds, if recorded."""
    efforts: Annotated[np.ndarray, Array("N J", "float64", unit="Nm")] | None = None
    """Torques, if recorded."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.positions.shape[1] != len(self.names) or len(set(self.names)) != len(self.names):
            raise ArtifactError(
                f"Joints: {len(set(self.names))} different names for {self.positions.shape[1]} columns", code="DXB-A517"
            )
        return self

    def at(self, stamps: np.ndarray) -> np.ndarray:
        """Positions (M, J) at times (M,) [s], interpolated linearly.

        Raises:
            ArtifactError: A time is outside the recording.
        """
        if len(stamps) and not (len(self.stamps) and self.stamps[0] <= stamps.min() <= stamps.max() <= self.stamps[-1]):
            known = f"{self.stamps[0]} to {self.stamps[-1]} s" if len(self.stamps) else "nothing"
            raise ArtifactError(
                "the joints were not recorded at all of these times",
                code="DXB-A518",
                facts={"recorded": known, "asked": f"{stamps.min()} to {stamps.max()} s"},
                hint="ask for times within the recording; both clocks must be the same",
            )
        return np.stack([np.interp(stamps, self.stamps, column) for column in self.positions.T], axis=1)
