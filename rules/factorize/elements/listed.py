"""factorize.listed: a `scene.yaml` as a part of a recipe."""

from __future__ import annotations

import json
from typing import Literal

from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

from . import scene_file

Pixels = tuple[NonNegativeInt, NonNegativeInt, NonNegativeInt, NonNegativeInt]
Point = tuple[NonNegativeInt, NonNegativeInt]


class JointOptions(Options):
    """A joint that somebody knows."""

    type: Literal["hinge", "slide"] = "hinge"
    """Its kind."""
    part_px: Pixels | None = None
    """Left, top, right, bottom of the part that moves [px]."""
    axis_px: tuple[Point, Point] | None = None
    """Two points of a hinge's axis [px]."""
    range_deg: tuple[float, float] | None = None
    """Limits of a hinge [deg]."""
    at_deg: float | None = None
    """Position of a hinge in the photograph [deg]."""


class ElementOptions(Options):
    """An element of the photograph; left out is what parsing proposes."""

    name: str
    """Unique name, lower case: `blue_mug`."""
    phrase: str | None = None
    """Words that a segmenter looks for."""
    category: str | None = None
    """`box`, `cylinder`, `bowl`, `mug`, `laptop`, `object`, or `support`, `robot`, `room`."""
    body_type: str | None = None
    """`rigid` or `articulated`."""
    material: str | None = None
    """A row of the material table."""
    at_px: Point | None = None
    """Column and row of one of its pixels [px]."""
    box: Pixels | None = None
    """Left, top, right, bottom [px]; pieces inside are one object."""
    interactive: bool | None = None
    """Whether it is an object, and not a part of the room."""
    joints: tuple[JointOptions, ...] | None = None
    """Joints that somebody knows."""


class ListedOptions(Options):
    """Options of factorize.listed."""

    elements: tuple[ElementOptions, ...] = Field(min_length=1)
    """What is in the photograph."""


@rule(version=1)
def listed(ctx: Context, *, options: ListedOptions) -> File:
    """Return the elements as a `scene.yaml` for `factorize.parse`."""
    elements = [element.model_dump(mode="json", exclude_none=True) for element in options.elements]
    data = json.dumps({"elements": elements}, indent=1).encode()
    wanted = scene_file.read(data)
    ctx.say(", ".join(element.name for element in wanted))
    return File(data=data)
