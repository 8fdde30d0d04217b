"""reference.place_robot_in_view: a robot next to the objects of a reference world, visible but hiding none of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.draw import Viewpoint
from dextera_build.artifacts.scenes.world import Part, RobotStand, Thing, World
from dextera_build.geometry import transforms
from dextera_build.rule import Context, Fraction, Options, rule

from .. import solids, textures
from ..room import fixture
from .surroundings import FLOOR_M

SIDE_M = 0.22
"""Edge length of the pedestal, and of the area that the base needs [m]."""


class PlaceRobotInViewOptions(Options):
    """Options of reference.place_robot_in_view. A value is drawn uniformly from each range."""

    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint -> position in the photograph [deg]; omitted joints are at home."""
    distance_m: tuple[PositiveFloat, PositiveFloat] = (0.5, 0.8)
    """Range of the distance from the base to the centre of the objects [m]."""
    aside_deg: NonNegativeFloat = 35.0
    """Largest angle between the base's x axis and the direction to the centre of the objects [deg]."""
    most_hidden: Fraction = 0.02
    """Largest fraction of an object's pixels that the robot may hide."""
    least_seen: Fraction = 0.02
    """Smallest fraction of the picture that shows the robot."""
    least_hand: Fraction = 0.01
    """Smallest fraction of the picture that shows its hand."""
    clear_m: NonNegativeFloat = 0.05
    """Smallest distance of the robot's joints and frames from the box around each object [m]."""
    tries: PositiveInt = 400
    """Number of positions tried."""


class PlaceRobotInViewBackend(Protocol):
    """Interface of a backend of reference.place_robot_in_view."""

    def points(
        self, ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Any
    ) -> list[np.ndarray]:
        """For each pose of the robot, the positions (P, 3) of its moving links and frames in the world [m]."""
        ...

    def sights(
        self, ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Any
    ) -> Iterator[tuple[np.ndarray, float, float]]:
        """For each pose: hidden fraction of each object's pixels (N,), fractions of the picture with robot and hand."""
        ...


@rule(version=1, packages=("numpy", "pillow", "manifold3d"), memory_gb=2.0)
def place_robot_in_view(
    ctx: Context[PlaceRobotInViewBackend],
    world: World,
    robot: RobotModel,
    viewpoint: Viewpoint,
    *,
    options: PlaceRobotInViewOptions | None = None,
) -> World:
    """Return the world with the robot at a random position on the table, or on a pedestal next to it.

    `viewpoint` gives the seed. The camera is unchanged; robot and hand are visible, and the robot hides at most
    `most_hidden` of each object.
    """
    options = options or PlaceRobotInViewOptions()
    ctx.check(bool(world.objects), "the world has no objects to place the robot next to", hint="draw more things")
    boxes = [_box(thing.surface.vertices, thing.pose.matrix) for thing in world.objects.values()]
    places = list(_places(world, boxes, viewpoint.seed, options))
    reached = ctx.backend.points(ctx, world, robot, places, ctx.backend_options)
    free = [
        place
        for place, points in zip(places, reached, strict=True)
        if points[:, 2].min() >= options.clear_m and not any(_near(points, box, options.clear_m) for box in boxes)
    ]
    sights = ctx.backend.sights(ctx, world, robot, free, ctx.backend_options)
    good = (each for each in zip(free, sights, strict=False) if _good(*each[1], options))
    found = next(good, None)
    if found is None:
        ctx.fail(
            f"none of {options.tries} places shows the robot next to the objects",
            hint="raise `tries` or `most_hidden`, or choose another posture with `joints_deg`",
        )
    placed, (_, seen, hand) = found
    ctx.say(f"the robot covers {seen:.0%} of the picture, its hand {hand:.1%}")
    return world.model_copy(update={"stand": placed, "fixtures": world.fixtures | pedestal(world, placed)})


def _good(hidden: np.ndarray, seen: float, hand: float, options: PlaceRobotInViewOptions) -> bool:
    """Whether robot, hand and objects are sufficiently visible."""
    return hidden.max() <= options.most_hidden and seen >= options.least_seen and hand >= options.least_hand


def _places(
    world: World, boxes: list[tuple[np.ndarray, np.ndarray]], seed: int, options: PlaceRobotInViewOptions
) -> Iterator[RobotStand]:
    """Random poses that are free of objects and furniture."""
    draw = np.random.default_rng([seed, 2])
    middle = np.mean([(low + high) / 2 for low, high in boxes], axis=0)
    furniture = [
        _box(thing.surface.vertices, thing.pose.matrix)
        for name, thing in world.fixtures.items()
        if name not in ("floor", "table") and not name.startswith("leg")
    ]
    joints = {name: float(np.radians(angle)) for name, angle in options.joints_deg.items()}
    for _ in range(options.tries):
        angle, distance = draw.uniform(-np.pi, np.pi), draw.uniform(*options.distance_m)
        aside = np.radians(options.aside_deg) * draw.uniform(-1, 1)
        place = np.array([*(middle[:2] + distance * np.array([np.cos(angle), np.sin(angle)])), 0.0])
        column = place + np.outer(np.linspace(0.0, 1.2, 13), [0.0, 0.0, 1.0])
        if not any(_near(column, box, SIDE_M / 2 + 0.02) for box in (*boxes, *furniture)):
            yield RobotStand(position=tuple(place.tolist()), yaw=float(angle + np.pi + aside), joints=joints)


def _box(vertices: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points = transforms.apply(pose, vertices.astype(np.float64))
    return points.min(axis=0), points.max(axis=0)


def _near(points: np.ndarray, box: tuple[np.ndarray, np.ndarray], distance: float) -> bool:
    """Whether any of points (N, 3) is within `distance` [m] of a box, or inside it."""
    gap = np.maximum(np.maximum(box[0] - points, points - box[1]), 0.0)
    return bool((np.linalg.norm(gap, axis=1) < distance).any())


def pedestal(world: World, placed: RobotStand) -> dict[str, Thing]:
    """A block from the floor to the base, unless the base is on the table."""
    low, high = _box(world.fixtures["table"].surface.vertices, world.fixtures["table"].pose.matrix)
    place = np.array(placed.position[:2])
    if (place - SIDE_M / 2 > low[:2]).all() and (place + SIDE_M / 2 < high[:2]).all():
        return {}
    steel = textures.plain(256, 256, (0.30, 0.31, 0.33), 0.03, 8, 3)
    # Slightly lower than the base, so that it does not coincide with the table's top where they overlap.
    mesh = solids.box((SIDE_M, SIDE_M, placed.position[2] - FLOOR_M - 0.001), steel)
    moved = solids.moved(mesh, transforms.rigid(np.eye(3), np.array([*place, FLOOR_M])))
    return {"pedestal": fixture("pedestal", Part(mesh=moved, gloss=0.2))}
