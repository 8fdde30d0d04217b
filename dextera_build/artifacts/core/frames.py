"""The declared frames of fields that hold a pose, and the check of poses against them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import AfterValidator, GetCoreSchemaHandler, ValidationInfo

from dextera_build.errors import ArtifactError


@dataclass(frozen=True)
class Frames:
    """The frames that a field's pose is between, used as `Annotated[Pose, Frames("world", "camera")]`.

    Args:
        parent: Frame of the resulting coordinates; None if the value names it.
        child: Frame of the given coordinates; None if the value names it.
    """

    parent: str | None
    child: str | None

    @property
    def declared(self) -> dict[str, str]:
        """The frames that every value has, by field of a pose."""
        both = {"parent": self.parent, "child": self.child}
        return {name: frame for name, frame in both.items() if frame is not None}

    def describe(self) -> str:
        """`T_world_camera`; `*` for a frame that the value names."""
        return f"T_{self.parent or '*'}_{self.child or '*'}"

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> Any:
        """The schema of `kind`, followed by the check of its frames."""
        return AfterValidator(self._check).__get_pydantic_core_schema__(kind, handler)

    def _check(self, pose: Any, field: ValidationInfo) -> Any:
        if self.parent not in (None, pose.parent) or self.child not in (None, pose.child):
            raise ArtifactError(
                f"`{field.field_name}` is T_{pose.parent}_{pose.child}, but {self.describe()} is declared",
                code="DXB-A207",
                hint="compose it with `@`, or take its `inverse()`, until its frames are the declared ones",
            )
        return pose
