"""reference.draw_list: random parameters of the photographs of a benchmark, by index."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.draw import Arrangement, Contact, Draw, Sensor, Viewpoint
from dextera_build.rule import Context, Fraction, Options, rule

Pitch: TypeAlias = Annotated[float, Field(ge=0.0, le=90.0)]
Roll: TypeAlias = Annotated[float, Field(ge=-180.0, le=180.0)]


class SweepOptions(Options):
    """Values of parameters that are varied one at a time; the others stay as drawn."""

    distance_m: tuple[PositiveFloat, ...] = ()
    """Distances [m]."""
    pitch_deg: tuple[Pitch, ...] = ()
    """Angles of the line of sight below the horizon [deg]."""
    roll_deg: tuple[Roll, ...] = ()
    """Rotations about the line of sight [deg]."""
    noise: tuple[NonNegativeFloat, ...] = ()
    """Factors on the depth noise."""
    dropout: tuple[Fraction, ...] = ()
    """Fractions of the depth that are lost in patches."""
    width_px: tuple[PositiveInt, ...] = ()
    """Widths of the picture [px]."""
    count: tuple[PositiveInt, ...] = ()
    """Numbers of objects."""
    contact: tuple[Contact, ...] = ()
    """Degrees of contact between the objects."""


class DrawListOptions(Options):
    """Options of reference.draw_list. A value is drawn uniformly from each range."""

    scenes: PositiveInt = 20
    """Number of scenes, or of scenes per swept value if `sweep` names any."""
    views: PositiveInt = 2
    """Number of photographs per scene."""
    first: NonNegativeInt = 0
    """Index of the first scene."""
    seed: NonNegativeInt = 0
    """Seed of the benchmark; a scene's seed is derived from it and the scene's index."""
    count: tuple[PositiveInt, PositiveInt] = (3, 8)
    """Range of the number of objects."""
    contact: tuple[Contact, ...] = ("apart", "touching", "piled")
    """Degrees of contact between the objects, used in turn by index."""
    distance_m: tuple[PositiveFloat, PositiveFloat] = (0.6, 1.0)
    """Range of the distance [m]."""
    pitch_deg: tuple[Pitch, Pitch] = (30.0, 60.0)
    """Range of the angle below the horizon [deg]."""
    roll_deg: tuple[Roll, Roll] = (-5.0, 5.0)
    """Range of the rotation about the line of sight [deg]."""
    width_px: PositiveInt = 640
    """Width of the picture [px]."""
    noise: NonNegativeFloat = 1.0
    """Factor on the depth noise."""
    dropout: Fraction = 0.0
    """Fraction of the depth that is lost in patches."""
    sweep: SweepOptions = SweepOptions()
    """Parameters to sweep; empty for none."""


@rule(version=1, packages=("numpy",))
def draw_list(ctx: Context, *, options: DrawListOptions | None = None) -> Collection[Draw]:
    """Return one draw per photograph, for `each`; a longer list begins with the scenes of a shorter one."""
    options = options or DrawListOptions()
    items = {}
    for axis, value in _points(options.sweep):
        numbers = range(options.first, options.first + options.scenes)
        for scene, view in itertools.product(numbers, range(options.views)):
            label = f"{scene:04d}_{view}" if not axis else f"{axis}={value} {scene:04d}_{view}"
            items[label] = _draw(options, scene, view, axis, value)
    ctx.say(f"{len(items)} photographs of {options.scenes} scenes")
    return Collection[Draw](items=items)


def _points(sweep: SweepOptions) -> Iterator[tuple[str, Any]]:
    """(parameter, value) of every point of the sweep; one empty point without a sweep."""
    points = [(axis, value) for axis in SweepOptions.model_fields for value in getattr(sweep, axis)]
    yield from points or [("", "")]


def _draw(options: DrawListOptions, scene: int, view: int, axis: str, value: Any) -> Draw:
    table = np.random.default_rng([options.seed, scene])
    camera = np.random.default_rng([options.seed, scene, 1 + view])
    facts: dict[str, Any] = {
        "count": int(table.integers(options.count[0], options.count[1] + 1)),
        "contact": options.contact[scene % len(options.contact)],
        "distance_m": round(float(camera.uniform(*options.distance_m)), 3),
        "pitch_deg": round(float(camera.uniform(*options.pitch_deg)), 1),
        "roll_deg": round(float(camera.uniform(*options.roll_deg)), 1),
        "width_px": options.width_px,
        "noise": options.noise,
        "dropout": options.dropout,
    }
    if axis:
        facts[axis] = value
    seeds = {"table": int(table.integers(2**31)), "camera": int(camera.integers(2**31))}
    return Draw(
        arrangement=Arrangement(seed=seeds["table"], count=facts["count"], contact=facts["contact"]),
        viewpoint=Viewpoint(
            seed=seeds["camera"], **{name: facts[name] for name in ("distance_m", "pitch_deg", "roll_deg", "width_px")}
        ),
        sensor=Sensor(seed=seeds["camera"], noise=facts["noise"], dropout=facts["dropout"]),
        axis=axis,
        value=str(value),
    )
