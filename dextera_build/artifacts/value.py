"""Small plain structures inside artifacts."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of its artifact."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Open(Value):
    """A `Value` with further fields of plain data, whose types only its users know.

    Values of its subclasses can be stored in its place; they are read back as the declared type.
    """

    model_config = ConfigDict(frozen=True, extra="allow")
