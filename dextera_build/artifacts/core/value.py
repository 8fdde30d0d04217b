"""Small plain structures inside artifacts."""

from __future__ import annotations

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, model_validator


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of its artifact."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Open(Value):
    """A `Value` with further fields of plain data, whose types only its users know.

    Where it is declared, a value of a subclass becomes one of the declared type, as it would be read back.
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    @model_validator(mode="wrap")  # one of mode `before` is not asked about instances
    @classmethod
    def _as_declared(cls, value: Any, made: ModelWrapValidatorHandler[Self]) -> Self:
        return made(value.model_dump() if isinstance(value, cls) and type(value) is not cls else value)
