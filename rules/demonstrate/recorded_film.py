"""demonstrate.recorded_film: pictures of episodes that were recorded in the world that replaces hardware."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from pydantic import NonNegativeFloat, PositiveInt

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.contract import check_data
from dextera_build.policy.observation import Frame
from dextera_build.rule import Context, Options, rule

from .film_packing import film_of


class RecordedFilmOptions(Options):
    """Options of demonstrate.recorded_film."""

    strip_frames: PositiveInt = 8
    """Frames in the preview of the first episode."""
    apart_rad: NonNegativeFloat = 0.01
    """Episodes of which a joint comes out farther from its recorded position than this are refused [rad or m]."""
    depth: bool = False
    """Whether each frame also has its depth, for policies on depth or points."""


class RecordedFilmBackend(Protocol):
    """Interface of a backend of demonstrate.recorded_film."""

    def frames(
        self, ctx: Context, world: TaskBundle, episodes: Episodes, view: View, common: RecordedFilmOptions, options: Any
    ) -> Iterator[tuple[str, Frame]]:
        """Index of each episode, and its frames with a leading axis of T steps."""
        ...


@rule(version=1, packages=("numpy",), runs={"world": "primitive"})
def recorded_film(
    ctx: Context[RecordedFilmBackend],
    world: TaskBundle,
    episodes: Episodes,
    view: View,
    *,
    options: RecordedFilmOptions | None = None,
) -> Film:
    """Return one frame (H, W, 3) uint8 sRGB per step of the kept episodes of `reference.episodes`, seen through `view`.

    They hold what a cell measured and not the state, so the commands are sent again from the recorded start: frame t is
    the scene before action t. The robot's joints, which encoders measure exactly, must come out as recorded.

    Raises:
        RuleError: The episodes are of another world, or a joint comes out otherwise.
    """
    options = options or RecordedFilmOptions()
    check_data(world, episodes)
    ctx.check(
        episodes.world == world.kind,
        f"the episodes were recorded in a {episodes.world} world, and `world` is {world.kind}",
        hint="film episodes of a twin with `demonstrate.film`",
    )
    taken: Iterator[tuple[str, Frame]] = ctx.backend.frames(ctx, world, episodes, view, options, ctx.backend_options)
    return film_of(ctx, episodes, view, taken, options.strip_frames)
