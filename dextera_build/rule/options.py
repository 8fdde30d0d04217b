"""Options of a rule or a backend, which a recipe may set."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Fraction = Annotated[float, Field(ge=0, le=1)]
"""A number from 0 to 1: a fraction, a probability, a colour channel."""


class Options(BaseModel):
    """Options of a rule: typed, frozen, every field in the key. Nested groups also derive from this class.

    Declare bounds and choices with pydantic: `wall_m: PositiveFloat = 0.003`, `qp: int = Field(22, ge=1, le=51)`,
    `Literal["png", "jpeg"]`. Planning refuses invalid values; bounds are not part of the key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
