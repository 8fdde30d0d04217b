"""Prompt of a vision-language model for a photograph, and validation of its answer."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from dextera_build.artifacts.objects.object import Element, Estimate
from dextera_build.errors import RuleError

PROMPT = """The photograph shows a workspace: a support (a table, a desk) and what stands on it.
Name everything that stands on the support or behind it. The picture is {width} {unit} wide and {height} {unit} high.
- name: unique, lower case, words joined by _: red_mug
- phrase: a short noun phrase: red mug
- category: box, cylinder, bowl, mug, laptop, robot, room or object
- body_type: articulated if it has joints (a laptop, a box with a lid), else rigid
- interactive: true if a hand could pick it up or move a part of it, false for walls, furniture and robots
- material: wood, plastic, ceramic, metal, glass, cardboard, rubber or fabric
- mass_g: mass in grams with what is in it; friction: coefficient of sliding friction on the support; restitution:
  coefficient of restitution of a slow fall onto it. Each is [low, high], so that 9 of 10 such things lie between
- box: left, top, right, bottom in {units} of this picture, tight around what is seen of it
Do not name the support itself."""
_TEXT = {"type": "string"}
_INTERVAL = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
MOST = {"mass_g": 100_000.0, "friction": 2.0, "restitution": 1.0}
"""Largest accepted values."""
_FIELDS: dict[str, Any] = {
    "name": _TEXT,
    "phrase": _TEXT,
    "category": {"enum": ["box", "cylinder", "bowl", "mug", "laptop", "robot", "room", "object"]},
    "body_type": {"enum": ["rigid", "articulated"]},
    "interactive": {"type": "boolean"},
    "material": {"enum": ["wood", "plastic", "ceramic", "metal", "glass", "cardboard", "rubber", "fabric"]},
    **dict.fromkeys(MOST, _INTERVAL),
    "box": {"type": "array", "items": {"type": "integer"}, "minItems": 4, "maxItems": 4},
}
_ITEM = {"type": "object", "properties": _FIELDS, "required": [*_FIELDS], "additionalProperties": False}
SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {"elements": {"type": "array", "items": _ITEM}},
    "required": ["elements"],
    "additionalProperties": False,
}
"""JSON schema of the answer; `Answer` validates it."""


@dataclass(frozen=True)
class Grid:
    """Coordinate system of a model's boxes; (0, 0) is the upper left corner of the picture."""

    width: int
    height: int
    unit: str = "px"
    units: str = "pixels"

    def prompt(self) -> str:
        """The prompt."""
        return PROMPT.format(width=self.width, height=self.height, unit=self.unit, units=self.units)

    def scale(self, shape: tuple[int, ...]) -> tuple[float, float]:
        """Pixels per unit, in x and y, of a picture of (H, W, ...) pixels."""
        return shape[1] / self.width, shape[0] / self.height


class Thing(BaseModel):
    """One element; its box is in units of a `Grid`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: str = Field(pattern=r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$", max_length=60)
    phrase: str = Field(min_length=1, max_length=200)
    category: Literal["box", "cylinder", "bowl", "mug", "laptop", "robot", "room", "object"]
    body_type: Literal["rigid", "articulated"]
    interactive: bool
    material: Literal["wood", "plastic", "ceramic", "metal", "glass", "cardboard", "rubber", "fabric"]
    mass_g: list[float] = Field(min_length=2, max_length=2)
    friction: list[float] = Field(min_length=2, max_length=2)
    restitution: list[float] = Field(min_length=2, max_length=2)
    box: list[int] = Field(min_length=4, max_length=4)


class Answer(BaseModel):
    """The required answer of a model."""

    model_config = ConfigDict(extra="forbid", strict=True)

    elements: list[Thing] = Field(min_length=1, max_length=64)


def read(text: str, grid: Grid) -> Answer:
    """Parse the text of an answer.

    Raises:
        RuleError: A value is impossible.
        ValueError: The text does not match the schema.
    """
    answer = Answer.model_validate_json(text)
    names = [thing.name for thing in answer.elements]
    for thing in answer.elements:
        left, top, right, bottom = thing.box
        if not (0 <= left < right <= grid.width and 0 <= top < bottom <= grid.height):
            size = f"{grid.width} × {grid.height} {grid.unit}"
            raise RuleError(
                f"the box of `{thing.name}` is {thing.box}, outside of the picture of {size}", code="DXB-B347"
            )
        if names.count(thing.name) > 1 or thing.name == "support":
            raise RuleError(f"the name `{thing.name}` is taken", code="DXB-B347")
        _in_order(thing)
    return answer


def _in_order(thing: Thing) -> None:
    """Refuse an interval that is empty or exceeds what is possible."""
    for key, most in MOST.items():
        low, high = getattr(thing, key)
        if not 0.0 <= low <= high <= most or (key == "mass_g" and low == 0.0):
            raise RuleError(
                f"`{key}` of `{thing.name}` is [{low:g}, {high:g}]; it is [low, high], between 0 and {most:g}",
                code="DXB-B347",
            )


def form() -> str:
    """Instructions on the format, for a model whose decoding is not constrained to the schema."""
    return "Answer with JSON alone, of this schema: " + json.dumps(SCHEMA)


def bare(text: str) -> str:
    """The JSON of an answer, without a Markdown fence if it has one."""
    fenced = re.fullmatch(r"```(?:json)?\s*(.*?)\s*```", text.strip(), re.DOTALL)
    return fenced[1] if fenced else text.strip()


def correction(why: object) -> str:
    """Message to the model about an invalid answer."""
    return f"This answer cannot be used: {why}\nAnswer again, with all of it corrected."


def elements(answer: Answer, grid: Grid, shape: tuple[int, ...]) -> tuple[Element, ...]:
    """The elements of an answer, each with its box in a picture of (H, W, ...) pixels [px]."""
    x, y = grid.scale(shape)
    return tuple(_element(thing, x, y) for thing in answer.elements)


def _element(thing: Thing, x: float, y: float) -> Element:
    left, top, right, bottom = thing.box
    box = (int(left * x), int(top * y), round(right * x), round(bottom * y))
    told = thing.model_dump(exclude=set(MOST))
    mass, friction, restitution = ((low, high) for low, high in (thing.mass_g, thing.friction, thing.restitution))
    grams = (mass[0] / 1000.0, mass[1] / 1000.0)
    estimate = Estimate(phrase=thing.phrase, mass_kg=grams, friction=friction, restitution=restitution)
    return Element(**{**told, "box": box, "estimate": estimate})
