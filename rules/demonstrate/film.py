"""demonstrate.film: render recorded episodes through a camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from pydantic import PositiveInt

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame
from dextera_build.rule import Context, Options, rule

from .film_packing import film_of

SMOOTH = 4
"""Samples per pixel of films for human viewers."""


class FilmOptions(Options):
    """Options of demonstrate.film."""

    strip_frames: PositiveInt = 8
    """Frames in the preview of the first episode."""
    first: PositiveInt | None = None
    """Number of episodes to film, in order; null: all, as data sets require."""
    width_px: PositiveInt | None = None
    """Width of the frames for human viewers, smoothed, with proportional height [px]; null: the frames of policies."""
    depth: bool = False
    """Whether each frame also has its depth, for policies on depth or points."""
    camera: str = PICTURE
    """Name of the camera among several of a policy, on which its errors of pose depend."""


class FilmBackend(Protocol):
    """Interface of a backend of demonstrate.film."""

    def frames(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        view: View,
        common: FilmOptions,
        options: Any,
    ) -> Iterator[tuple[str, Frame]]:
        """Index of each episode, and its frames with a leading axis of T steps."""
        ...


@rule(version=1, packages=("numpy",))
def film(
    ctx: Context[FilmBackend], bundle: TaskBundle, episodes: Episodes, view: View, *, options: FilmOptions
) -> Film:
    """Return one frame (H, W, 3) uint8 sRGB per step of the kept episodes, seen through `view`.

    Recorded states are rendered without simulation; frame t is the scene before action t. Depth is exact, rounded to
    millimetres.
    """
    chosen, view = _chosen(episodes, options.first), _sized(view, options.width_px)
    taken: Iterator[tuple[str, Frame]] = ctx.backend.frames(ctx, bundle, chosen, view, options, ctx.backend_options)
    return film_of(ctx, chosen, view, taken, options.strip_frames)


def _chosen(episodes: Episodes, first: int | None) -> Episodes:
    return episodes.model_copy(update={"items": dict(episodes.in_order()[:first])}) if first else episodes


def _sized(view: View, width_px: int | None) -> View:
    if width_px is None:
        return view
    camera = view.camera.scaled(width_px / view.camera.width)
    return view.model_copy(update={"camera": camera, "samples": max(view.samples, SMOOTH)})
