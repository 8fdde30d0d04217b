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
    """A known joint."""

    type: Literal["hinge", "slide"] = "hinge"
    """Type of the joint."""
    part_px: Pixels | None = None
    """Left, top, right, bottom of the moving part [px]."""
    axis_px: tuple[Point, Point] | None = None
    """Two points of a hinge's axis [px]."""
    range_deg: tuple[float, float] | None = None
    """Limits of a hinge [deg]."""
    at_deg: float | None = None
    """Position of a hinge in the photograph [deg]."""


class ElementOptions(Options):
    """An element of the photograph; fields that are not set are taken from the proposal."""

    name: str
    """Unique name, lower case: `blue_mug`."""
    phrase: str | None = None
    """Phrase for text-prompted segmentation."""
    category: str | None = None
    """`box`, `cylinder`, `bowl`, `mug`, `laptop`, `object`, or `support`, `robot`, `room`."""
    body_type: str | None = None
    """`rigid` or `articulated`."""
    material: str | None = None
    """A row of the material table."""
    at_px: Point | tuple[Point, ...] | None = None
    """Column and row of one of its pixels [px], or of one in each region that belongs to it."""
    box: Pixels | None = None
    """Left, top, right, bottom [px]; pieces inside are one object."""
    interactive: bool | None = None
    """Whether it is a movable object rather than a part of the room."""
    joints: tuple[JointOptions, ...] | None = None
    """Known joints."""


class ListedOptions(Options):
    """Options of factorize.listed."""

    elements: tuple[ElementOptions, ...] = Field(min_length=1)
    """Elements of the photograph."""


@rule(version=1)
def listed(ctx: Context, *, options: ListedOptions) -> File:
    """Return the elements as a `scene.yaml` for `factorize.parse`."""
    elements = [element.model_dump(mode="json", exclude_none=True) for element in options.elements]
    data = json.dumps({"elements": elements}, indent=1).encode()
    wanted = scene_file.read(data)
    ctx.say(", ".join(element.name for element in wanted))
    return File(data=data)
