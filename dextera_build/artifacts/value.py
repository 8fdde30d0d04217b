"""Small plain structures inside artifacts."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of its artifact."""

    model_config = ConfigDict(frozen=True, extra="forbid")
