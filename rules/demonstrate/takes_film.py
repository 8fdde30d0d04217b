"""demonstrate.takes_film: a film of what an operator demonstrated by hand, with the hands."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any, Protocol

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats import video
from dextera_build.policy.contract import check_data
from dextera_build.rule import Context, Options, rule

from .film_strip import strip

STRIP = 8
"""Pictures in the preview."""


class TakesFilmOptions(Options):
    """Options of demonstrate.takes_film."""

    first: PositiveInt = 3
    """Number of takes to film, in order; those that failed, too, if they are among the episodes."""
    width_px: PositiveInt = Field(480, multiple_of=16)
    """Width of a picture; its height is three quarters of it [px]."""
    rate_hz: PositiveFloat = 20.0
    """Pictures per second, at most one per control step."""


class TakesFilmBackend(Protocol):
    """Interface of a backend of demonstrate.takes_film."""

    def frames(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        recording: HandStream,
        common: TakesFilmOptions,
        options: Any,
    ) -> Iterator[np.ndarray]:
        """Pictures (H, W, 3) uint8 of the takes, one after another, `rate_hz` of them per second."""
        ...


@rule(version=1, packages=("numpy", "pillow", "av"))
def takes_film(
    ctx: Context[TakesFilmBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    recording: HandStream,
    *,
    options: TakesFilmOptions | None = None,
) -> Video:
    """Return a film of takes: the twin, transparent the robot's hands at their targets, the operator's as skeletons.

    States are the recorded ones, without simulation, so that the film shows what the operator saw. The operator's
    hands are drawn where the recording has them, if it is in the robot's frame `base`, as `dxb teleop` writes it.

    Raises:
        RuleError: The episodes are of another task, or are no takes of the recording.
    """
    options = options or TakesFilmOptions()
    check_data(bundle, episodes)
    takes = len(recording.demonstrations)
    ctx.check(
        all(index.isdigit() and int(index) < takes for index in episodes.items),
        "the episodes are not those of the recording's takes",
        hint="give those of `demonstrate.operate` with this recording",
        takes=takes,
        episodes=", ".join(list(episodes.items)[:3]),
    )
    pictures = ctx.backend.frames(ctx, bundle, episodes, recording, options, ctx.backend_options)
    first = next(pictures)
    kept = [first]
    encoder = video.encoder(first.shape[1], first.shape[0], options.rate_hz)
    made = video.write(ctx.scratch / "takes.mp4", _noting(chain([first], pictures), kept), encoder)
    ctx.preview(strip(np.stack(kept), STRIP), f"{episodes.task} by hand")
    ctx.say(f"{len(made.stamps):,} pictures of {made.width} x {made.height} px, hands from {recording.device}")
    return made


def _noting(pictures: Iterator[np.ndarray], kept: list[np.ndarray], every: int = 10) -> Iterator[np.ndarray]:
    """Pass pictures on, and keep some of them."""
    for number, picture in enumerate(pictures):
        if number and number % every == 0:
            kept.append(picture)
        yield picture
