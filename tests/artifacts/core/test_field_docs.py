"""What fields mean, as their docstrings say it."""

from __future__ import annotations

from typing import Generic, TypeVar

from pydantic import BaseModel, Field, PositiveFloat

from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.core.field_docs import bounds, field_docs
from dextera_build.rule import Fraction

T = TypeVar("T")


class Above(BaseModel):
    """Two fields."""

    one: int
    """The first
    of two."""
    two: int = 2
    """The second."""
    silent: int = 0
    shown: int = Field(0, description="As it bears it.")


class Below(Above):
    """One of them anew."""

    two: int = 3
    """Another."""

    def said(self) -> str:
        """Not a field."""
        return str(self.one)


class Box(BaseModel, Generic[T]):
    """A generic one."""

    inside: T
    """What it holds."""


def test_docstrings_are_found_and_the_nearest_counts() -> None:
    assert field_docs(Above) == {"one": "The first\nof two.", "two": "The second.", "shown": "As it bears it."}
    assert field_docs(Below) == {**field_docs(Above), "two": "Another."}


def test_a_class_within_a_function_and_one_without_source_have_what_can_be_had() -> None:
    class Inner(Above):
        three: int = 3
        """Within."""

    assert field_docs(Inner)["three"] == "Within."
    assert field_docs(Box[int]) == {"inside": "What it holds."}
    made: dict[str, object] = {}
    exec("from pydantic import BaseModel\nclass Made(BaseModel):\n    a: int\n    'Lost.'\n", made)
    assert field_docs(made["Made"]) == {}  # type: ignore[arg-type]


def test_artifacts_say_what_they_hold() -> None:
    assert set(field_docs(Collection[File])) == {"items"}


class Bounded(BaseModel):
    """Options with bounds of every form."""

    free: float = 0.0
    wall_m: PositiveFloat = 0.003
    held_out: float = Field(0.1, ge=0, lt=1)
    colour: tuple[Fraction, Fraction, Fraction] = (0.0, 0.0, 0.0)
    weighed_kg: PositiveFloat | None = None


def test_bounds_are_written_as_people_write_them():
    said = {name: bounds(field) for name, field in Bounded.model_fields.items()}
    assert said == {"free": "", "wall_m": "> 0", "held_out": ">= 0, < 1", "colour": ">= 0, <= 1", "weighed_kg": "> 0"}
