"""The episode sets that a learner reads: one set, or those of a mixture, with their pictures."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dextera_build import digest
from dextera_build.artifacts import base
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.policy import contract as contracts

ALONE = ""
"""Label of the only part."""


@dataclass(frozen=True)
class Part:
    """Episodes of one world."""

    label: str
    """Its name in the mixture; `ALONE` without one."""
    episodes: Episodes
    film: Film | Pixels | None
    """Its pictures."""
    weight: int
    """Its samples in a batch, relative to the other parts."""

    @property
    def lengths(self) -> list[int]:
        """Number of steps of each episode."""
        return [len(episode.action) for episode in self.episodes.items.values()]

    def named(self, episode: str) -> str:
        """An episode's name among those of all parts."""
        return f"{self.label}/{episode}" if self.label else episode

    @cached_property
    def pixels(self) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 of each episode, in memory or, if they were unpacked, memory-mapped."""
        return [_frames(self.film, name) for name in self.episodes.items] if self.film else []

    @cached_property
    def depths(self) -> list[np.ndarray]:
        """Distances (T, H, W) uint16 of each episode in counts of `DEPTH_STEP_M`; none if the film has no depth."""
        film = self.film
        if film is None or not film.depth:
            return []
        return [film.depth[name] if isinstance(film, Pixels) else film.counts(name) for name in self.episodes.items]

    def digest(self) -> str:
        """The digest of its data."""
        film = self.film.encode(digest.of_bytes) if self.film else None
        return digest.of_value([self.episodes.encode(digest.of_bytes), film])


class Frames:
    """Pictures of all steps, one episode after another.

    Args:
        episodes: Frames (T, H, W, 3) uint8, or distances (T, H, W) uint16, of each episode.
    """

    def __init__(self, episodes: Sequence[np.ndarray]) -> None:
        self._episodes = episodes
        self._first = np.cumsum([0, *map(len, episodes)])

    def at(self, rows: np.ndarray) -> np.ndarray:
        """The pictures (N, ...) of steps (N,) int64."""
        numbers = np.searchsorted(self._first, rows, side="right") - 1
        found = np.empty((len(rows), *self._episodes[0].shape[1:]), self._episodes[0].dtype)
        for place, (number, row) in enumerate(zip(numbers, rows - self._first[numbers], strict=True)):
            found[place] = self._episodes[number][row]
        return found


def parts_of(
    episodes: Episodes | Mixture,
    film: Film | Pixels | None = None,
    films: base.Collection[Film | Pixels] | None = None,
) -> list[Part]:
    """The parts of the input of a learner.

    Raises:
        RuleError: Pictures are missing, or are not those of a part.
    """
    if isinstance(episodes, Episodes):
        _refuse(films is not None, "`films` are for a mixture, but one set of episodes is given", hint="give `film`")
        return [Part(ALONE, episodes, film, 1)]
    _refuse(film is not None, "`film` is for one set of episodes, but a mixture is given", hint="give `films` by label")
    given = {} if films is None else dict(films.items)
    lost = sorted(episodes.parts.keys() ^ given.keys()) if given else []
    _refuse(bool(lost), f"the films do not match the mixture in `{lost[0] if lost else ''}`", films=listing(given))
    return [
        Part(label, each, given.get(label), episodes.weights[label]) for label, each in sorted(episodes.parts.items())
    ]


def check(bundle: TaskBundle, parts: Sequence[Part], inputs: Collection[str]) -> None:
    """Raise for parts that do not fit the task, or from which nothing can be learned.

    Args:
        bundle: The task.
        parts: The parts.
        inputs: Channels that the policy takes.

    Raises:
        RuleError: A part has no episode, is of another task, or its film does not show every step.
    """
    for part in parts:
        contracts.check_data(bundle, part.episodes)
        _refuse(
            not part.episodes.items,
            "no episode succeeded, so there is nothing to learn from",
            attempts=part.episodes.attempts,
        )
        _refuse(
            part.film is not None and contracts.CAMERAS.keys().isdisjoint(inputs),
            f"a film is given, but none of {listing(contracts.CAMERAS)} is among the inputs",
            hint="inputs: [joints, goal, rgb]",
        )
        if part.film is not None:
            _check_film(part, part.film)
            wanted = [name for name in ("depth", "cloud") if name in inputs]
            _refuse(
                bool(wanted) and not part.film.depth,
                f"the film has no depth, from which `{listing(wanted)}` is made",
                part=part.label or None,
                hint="film with `depth: true` in `demonstrate.film`",
            )

    sizes = {part.label: f"{part.film.width} x {part.film.height} px" for part in parts if part.film is not None}
    _refuse(
        len(set(sizes.values())) > 1,
        "the films of the parts differ in size",
        hint="film all parts with one `view`",
        sizes=", ".join(f"`{label}` {size}" for label, size in sizes.items()),
    )


def _check_film(part: Part, film: Film | Pixels) -> None:
    episodes, shown = part.episodes, film.episodes if isinstance(film, Pixels) else film.frames
    lost = [name for name in episodes.items if name not in shown]
    _refuse(
        bool(lost), f"the film lacks {len(lost)} of {len(episodes.items)} episodes", first=lost[0] if lost else None
    )
    for (name, episode), pixels in zip(episodes.items.items(), part.pixels, strict=True):
        steps = len(pixels)
        _refuse(steps != len(episode.action), f"episode `{name}` has {len(episode.action)} steps, but {steps} frames")


def _frames(film: Film | Pixels, name: str) -> np.ndarray:
    return film.episodes[name] if isinstance(film, Pixels) else film.pixels(name)


def _refuse(wrong: bool, message: str, *, hint: str | None = None, **facts: object) -> None:
    if wrong:
        raise RuleError(message, code="DXB-B516", hint=hint, facts={k: v for k, v in facts.items() if v is not None})
