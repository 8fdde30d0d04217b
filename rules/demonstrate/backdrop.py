"""demonstrate.backdrop: other backgrounds for the pictures of a film, of the twin itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveInt

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.variation import Twist
from dextera_build.policy.cameras import PICTURE
from dextera_build.rule import Context, Options, rule


class BackdropOptions(Options):
    """Options of demonstrate.backdrop."""

    pictures: PositiveInt = 32
    """Number of pictures of the background."""
    shift_m: NonNegativeFloat = 0.1
    """Standard deviation of the camera's place in these pictures, along each axis [m]."""
    turn_deg: NonNegativeFloat = 8.0
    """Standard deviation of its rotation, about each axis [deg]."""
    light: float = Field(0.4, ge=0.0, lt=1.0)
    """Maximum random change of their light, as a fraction of 1."""
    seed: NonNegativeInt = 0
    """Seed of these draws."""
    camera: str = PICTURE
    """Name of the camera among several, as of the film."""


class BackdropBackend(Protocol):
    """Interface of a backend of demonstrate.backdrop."""

    def masks(
        self, ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, camera: str, options: Any
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Index of each episode, and the pixels (T, H, W) bool of the robot and the objects."""
        ...

    def behind(
        self, ctx: Context, bundle: TaskBundle, view: View, draws: list[tuple[Twist, float]], options: Any
    ) -> Iterator[np.ndarray]:
        """A picture (H, W, 3) uint8 of the scene without robot and objects for each error of the camera and light."""
        ...

    def among(
        self, ctx: Context, splats: Splats, view: View, draws: list[tuple[Twist, float]], options: Any
    ) -> Iterator[np.ndarray]:
        """The same of Gaussians in the frame of the world."""
        ...


@rule(version=1, packages=("numpy",), runs={"bundle": "primitive"})
def backdrop(
    ctx: Context[BackdropBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    view: View,
    splats: Splats | None = None,
    *,
    options: BackdropOptions,
) -> Backdrop:
    """Return what learners need to replace the background of the film of these episodes through `view`.

    Robot and objects are told from the background by the twin, not by the colours. The other backgrounds are the twin's
    own, seen by a camera that is moved, turned and lit at random; with `splats`, Gaussians of the same place, every
    second one is drawn from these.
    """
    masks, shares = dict[str, np.ndarray](), [0.0] if not episodes.items else []
    for index, shown in ctx.backend.masks(ctx, bundle, episodes, view, options.camera, ctx.backend_options):
        expected = (len(episodes.items[index].joints), view.camera.height, view.camera.width)
        ctx.check(shown.shape == expected, "an episode has another number of masks than steps", episode=index)
        masks[index] = Backdrop.packed(shown)
        shares.append(float(shown.mean()))
        ctx.progress(len(masks), len(episodes.items), "episodes")
    ctx.check(masks.keys() == episodes.items.keys(), "an episode has no masks")
    if splats is not None:
        ctx.check(splats.frame == "world", "the Gaussians are not in the frame of the twin", frame=splats.frame)
    draws = _draws(options)
    half = draws[1::2] if splats is not None else []
    own = draws[::2] if splats is not None else draws
    pictures = [*ctx.backend.behind(ctx, bundle, view, own, ctx.backend_options)]
    if splats is not None:
        pictures += ctx.backend.among(ctx, splats, view, half, ctx.backend_options)
    ctx.metric("foreground", 100 * float(np.mean(shares)), "%")
    ctx.say(f"{len(masks)} episodes, {len(pictures)} backgrounds, {len(half)} of them of Gaussians")
    return Backdrop(masks=masks, pictures=np.stack(pictures))


def _draws(options: BackdropOptions) -> list[tuple[Twist, float]]:
    """Error of the camera's pose and factor of the light of each picture."""
    random, turn = np.random.default_rng([options.seed, 11]), math.radians(options.turn_deg)
    found = []
    for _ in range(options.pictures):
        x, y, z, a, b, c = (random.standard_normal(6) * ([options.shift_m] * 3 + [turn] * 3)).tolist()
        found.append(((x, y, z, a, b, c), float(1.0 + options.light * random.uniform(-1.0, 1.0))))
    return found
