"""evaluate.film: a film of a success and a failure of every policy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.formats import video
from dextera_build.policy.contract import check_data
from dextera_build.rule import Context, Options, rule

from .panels import GAP, PAPER, beside, titled
from .strip import moments

STILLS = 6
"""Pictures in the preview of each policy."""


class FilmOptions(Options):
    """Options of evaluate.film."""

    width_px: int = Field(400, ge=64, le=1280)
    """Width of one picture, of which two are side by side [px]."""
    rate_hz: PositiveFloat = 10.0
    """Pictures per second of the episode, at most one per control period; the film plays in the same time."""


class FilmBackend(Protocol):
    """Interface of a backend of evaluate.film."""

    def pictures(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episode: Episode,
        rows: np.ndarray,
        view: View | None,
        common: FilmOptions,
        options: Any,
    ) -> np.ndarray:
        """Pictures (len(rows), H, W, 3) uint8 of an episode of `bundle` before its actions `rows`."""
        ...


@rule(version=1, packages=("numpy", "pillow", "av"))
def film(
    ctx: Context[FilmBackend],
    bundle: TaskBundle,
    trials: Collection[Trials],
    view: View | None = None,
    *,
    options: FilmOptions,
) -> Video:
    """Return a film of the first success and the first failure of each set of trials, side by side, one after another.

    Recorded states are rendered without simulation, through `view`, otherwise from in front of the table. An episode
    that ends earlier stays as it ended.

    Raises:
        RuleError: Trials are of another task or world, or none of them kept an episode.
    """
    shown = {}
    for label, each in trials.items.items():
        check_data(bundle, each.examples)
        ctx.check(
            each.world == bundle.kind,
            f"`{label}` was tried in another world",
            hint="give the task of that world as `bundle`",
            trials=each.world,
            bundle=bundle.kind,
        )
        shown[label] = [(f"{each.label}: {title}", episode) for title, episode in _examples(each)]
    ctx.check(any(shown.values()), "the trials kept no episode", trials=", ".join(list(shown)[:6]))
    frames = _frames(ctx, bundle, {name: each for name, each in shown.items() if each}, view, options)
    first = next(frames)
    encoder = video.encoder(first.shape[1], first.shape[0], _every(bundle, options)[1])
    made = video.write(ctx.scratch / "film.mp4", _chained(first, frames), encoder)
    ctx.say(f"{sum(map(len, shown.values()))} episodes of {len(shown)} policies, {len(made.stamps):,} pictures")
    return made


def _examples(trials: Trials) -> Iterator[tuple[str, Episode]]:
    """The success and the failure that were kept, each with its title."""
    for number, episode in sorted(trials.examples.items.items())[:1]:
        yield f"success, trial {number}", episode
    for number, episode in sorted(trials.examples.failures.items())[:1]:
        yield f"trial {number}: {episode.reason}", episode


def _frames(
    ctx: Context,
    bundle: TaskBundle,
    shown: dict[str, list[tuple[str, Episode]]],
    view: View | None,
    options: FilmOptions,
) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8, as wide for one episode as for two, with even sides."""
    for label, episodes in shown.items():
        steps = max(len(episode.action) for _, episode in episodes)
        rows = np.arange(0, steps + 1, _every(bundle, options)[0])
        panes = []
        for title, episode in episodes:
            pictures = ctx.backend.pictures(ctx, bundle, episode, rows, view, options, ctx.backend_options)
            panes.append([titled(picture, title) for picture in pictures])
        whole = [_even(_pair(list(pair))) for pair in zip(*panes, strict=True)]
        ctx.preview(np.concatenate([whole[row] for row in moments(len(whole), STILLS)]), f"{bundle.task.name}, {label}")
        yield from whole


def _every(bundle: TaskBundle, options: FilmOptions) -> tuple[int, float]:
    """Control periods per picture, and pictures per second."""
    every = max(1, round(bundle.task.control_hz / options.rate_hz))
    return every, bundle.task.control_hz / every


def _pair(panes: list[np.ndarray]) -> np.ndarray:
    blank = np.full(panes[0].shape, PAPER[0], np.uint8)
    return np.pad(
        beside(panes[0], (*panes[1:], blank)[0], axis=1), ((0, GAP), (0, 0), (0, 0)), constant_values=PAPER[0]
    )


def _even(picture: np.ndarray) -> np.ndarray:
    return picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]


def _chained(first: np.ndarray, rest: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    yield first
    yield from rest
