"""The episode sets that a learner reads: one set, or those of a mixture, with their pictures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dextera_build import digest
from dextera_build.artifacts import base
from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.policy import cameras
from dextera_build.policy import contract as contracts
from dextera_build.policy.cameras import PICTURE

ALONE = ""
"""Label of the only part."""


@dataclass(frozen=True)
class Part:
    """Episodes of one world."""

    label: str
    """Its name in the mixture; `ALONE` without one."""
    episodes: Episodes
    films: Mapping[str, Film | Pixels]
    """Camera -> its pictures; the only camera is called `PICTURE`."""
    weight: int
    """Its samples in a batch, relative to the other parts."""
    backdrops: Mapping[str, Backdrop] = field(default_factory=dict)
    """Camera -> other backgrounds of its pictures."""

    @property
    def lengths(self) -> list[int]:
        """Number of steps of each episode."""
        return [len(episode.action) for episode in self.episodes.items.values()]

    def named(self, episode: str) -> str:
        """An episode's name among those of all parts."""
        return f"{self.label}/{episode}" if self.label else episode

    @cached_property
    def pixels(self) -> dict[str, list[np.ndarray]]:
        """Camera -> frames (T, H, W, 3) uint8 of each episode, in memory or, if they were unpacked, memory-mapped."""
        names = list(self.episodes.items)
        return {camera: [_frames(film, name) for name in names] for camera, film in self.films.items()}

    @cached_property
    def depths(self) -> dict[str, list[np.ndarray]]:
        """Camera whose film has depth -> distances (T, H, W) uint16 of each episode in counts of `DEPTH_STEP_M`."""
        names = list(self.episodes.items)
        deep = {camera: film for camera, film in self.films.items() if film.depth}
        return {camera: [_counts(film, name) for name in names] for camera, film in deep.items()}

    def digest(self) -> str:
        """The digest of its data."""
        films = {camera: film.encode(digest.of_bytes) for camera, film in sorted(self.films.items())}
        shown = films.get(PICTURE) if films.keys() <= {PICTURE} else films
        behind = {camera: each.encode(digest.of_bytes) for camera, each in sorted(self.backdrops.items())}
        return digest.of_value([self.episodes.encode(digest.of_bytes), shown, *([behind] if behind else [])])


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

    Args:
        episodes: One set of episodes, or a mixture.
        film: What the only camera saw in one set.
        films: What several cameras saw, by camera; of a mixture by label, or by `LABEL.CAMERA` if there are several.

    Raises:
        RuleError: Pictures are missing, or are not those of a part.
    """
    given = {} if films is None else dict(films.items)
    if isinstance(episodes, Episodes):
        _refuse(
            film is not None and films is not None, "`film` is for one camera, `films` for several", hint="give one"
        )
        cameras.check_names(given)
        return [Part(ALONE, episodes, {PICTURE: film} if film is not None else given, 1)]
    _refuse(film is not None, "`film` is for one set of episodes, but a mixture is given", hint="give `films` by label")
    found = {label: dict[str, Film | Pixels]() for label in sorted(episodes.parts)}
    for key, each in given.items():
        label, _, camera = (key, "", "") if key in found else key.rpartition(".")
        cameras.check_names([camera] if camera else ())
        found.setdefault(label or key, {})[camera or PICTURE] = each
    lost = sorted(label for label, seen in found.items() if label not in episodes.parts or not seen) if given else []
    _refuse(bool(lost), f"the films do not match the mixture in `{lost[0] if lost else ''}`", films=listing(given))
    return [Part(label, episodes.parts[label], seen, episodes.weights[label]) for label, seen in found.items()]


def check(bundle: TaskBundle, parts: Sequence[Part], inputs: Collection[str]) -> None:
    """Raise for parts that do not fit the task, or from which nothing can be learned.

    Args:
        bundle: The task.
        parts: The parts.
        inputs: Channels that the policy takes, those of several cameras one by one.

    Raises:
        RuleError: A part has no episode, is of another task, or a film does not show every step.
    """
    _check_alike(parts)
    for part in parts:
        contracts.check_data(bundle, part.episodes)
        _refuse(
            not part.episodes.items,
            "no episode succeeded, so there is nothing to learn from",
            attempts=part.episodes.attempts,
        )
        for camera, film in part.films.items():
            terms = [cameras.term_of(name) for name in inputs if _is_of(name, camera)]
            _refuse(
                not terms,
                f"a film{_of(camera)} is given, but none of {listing(cameras.TERMS)} is among the inputs",
                hint="inputs: [joints, goal, rgb]",
            )
            wanted = [term for term in ("depth", "cloud") if term in terms]
            _refuse(
                bool(wanted) and not film.depth,
                f"the film{_of(camera)} has no depth, from which `{listing(wanted)}` is made",
                part=part.label or None,
                hint="film with `depth: true` in `demonstrate.film`",
            )
            _check_shown(part, camera, film)
        _check_steps(part)


def _check_alike(parts: Sequence[Part]) -> None:
    """Raise for parts whose cameras differ."""
    first = parts[0]
    for part in parts[1:]:
        lost = sorted(first.films.keys() ^ part.films.keys())
        _refuse(
            bool(lost),
            f"only one of the parts `{first.label}` and `{part.label}` has a film of `{lost[0] if lost else ''}`",
            hint="give films of the same cameras for all parts",
        )
    for camera in first.films:
        shown = {part.label: part.films[camera] for part in parts}
        sizes = {label: f"{film.width} x {film.height} px" for label, film in shown.items()}
        _refuse(
            len(set(sizes.values())) > 1,
            f"the films of the parts differ in size{_of(camera)}",
            hint="film all parts with one `view`",
            sizes=", ".join(f"`{label}` {size}" for label, size in sizes.items()),
        )


def _check_shown(part: Part, camera: str, film: Film | Pixels) -> None:
    episodes, shown = part.episodes, film.episodes if isinstance(film, Pixels) else film.frames
    lost = [name for name in episodes.items if name not in shown]
    _refuse(
        bool(lost),
        f"the film{_of(camera)} lacks {len(lost)} of {len(episodes.items)} episodes",
        first=lost[0] if lost else None,
    )


def _check_steps(part: Part) -> None:
    for camera, shown in part.pixels.items():
        for name, steps, pixels in zip(part.episodes.items, part.lengths, shown, strict=True):
            count = len(pixels)
            _refuse(count != steps, f"episode `{name}` has {steps} steps, but {count} frames{_of(camera)}")


def _is_of(channel: str, camera: str) -> bool:
    return cameras.is_seen(channel) and cameras.camera_of(channel) == camera


def _of(camera: str) -> str:
    """A camera among several, in a sentence."""
    return "" if camera == PICTURE else f" of camera `{camera}`"


def _frames(film: Film | Pixels, name: str) -> np.ndarray:
    return film.episodes[name] if isinstance(film, Pixels) else film.pixels(name)


def _counts(film: Film | Pixels, name: str) -> np.ndarray:
    return film.depth[name] if isinstance(film, Pixels) else film.counts(name)


def _refuse(wrong: bool, message: str, *, hint: str | None = None, **facts: object) -> None:
    if wrong:
        raise RuleError(message, code="DXB-B516", hint=hint, facts={k: v for k, v in facts.items() if v is not None})
