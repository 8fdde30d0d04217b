"""Small plain structures inside artifacts."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of the artifact that holds it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
