"""reference.draw: a random reference world with objects at rest on a table, room and lights."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.draw import Arrangement
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from . import places, surroundings


class DrawOptions(Options):
    """Options of reference.draw."""

    seconds: PositiveFloat = 6.0
    """Maximum simulated time until all objects rest [s]."""


class FallBackend(Protocol):
    """Interface of a backend of reference.draw."""

    def let_fall(
        self, ctx: Context, things: dict[str, Thing], low: np.ndarray, high: np.ndarray, seconds: float, options: Any
    ) -> dict[str, np.ndarray]:
        """T_reference_thing (4, 4) of the objects at rest on the table between its corners `low` and `high` (2,)."""
        ...


# Contacts amplify rounding differences while objects fall.
@rule(
    version=1,
    packages=("numpy", "pillow", "manifold3d"),
    tolerance=Tolerance({"": ROUNDING, "objects.pose.matrix": 0.1}),
)
def draw(
    ctx: Context[FallBackend],
    arrangement: Arrangement,
    things: Collection[Thing],
    *,
    options: DrawOptions | None = None,
) -> World:
    """Return the world of one arrangement: objects at rest on a table [m], in a room with furniture and lamps.

    Objects that fell off the table are left out. The camera stands in front of the table; `reference.look_at` moves it.
    """
    options = options or DrawOptions()
    rng = np.random.default_rng(arrangement.seed)
    ctx.check(bool(things.items), "there are no things to draw from", hint="list entries of `reference.catalogue`")
    names = sorted(things.items)
    picked = [names[number] for number in rng.permutation(len(names))[: arrangement.count]]
    table = surroundings.table(rng)
    low, high = table.bounds()
    start = places.scattered({name: things.items[name] for name in picked}, arrangement.contact, low, high, rng)
    rested = ctx.backend.let_fall(ctx, start, low, high, options.seconds, ctx.backend_options)
    objects = {
        name: start[name].model_copy(update={"pose": Pose(parent="reference", child="thing", matrix=pose)})
        for name, pose in rested.items()
    }
    ctx.say(f"{', '.join(objects)}; {len(picked) - len(objects)} fell off the table")
    fixtures = surroundings.fixtures(table, rng)
    lamps, ambient = surroundings.light(rng)
    return World(
        objects=objects,
        fixtures=fixtures,
        lamps=lamps,
        ambient=ambient,
        camera=Camera(width=640, height=480, fx=614.0, fy=614.0, cx=319.5, cy=239.5),
        camera_pose=Pose(
            parent="reference", child="camera", matrix=cameras.look_down(np.zeros(3), 1.0, 0.0, np.pi / 4, 0.0)
        ),
    )
