"""Other backgrounds of the films that a learner reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dextera_build.artifacts import base
from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.errors import RuleError, listing
from dextera_build.learning.parts import ALONE, Part
from dextera_build.policy.cameras import PICTURE


def behind(
    parts: Sequence[Part], swap: float, backdrop: Backdrop | None, backdrops: base.Collection[Backdrop] | None
) -> list[Part]:
    """The parts with other backgrounds of their films.

    Args:
        parts: The parts.
        swap: Fraction of the samples whose background is replaced.
        backdrop: That of the only camera of one set.
        backdrops: Those of several cameras or of a mixture, by the keys of `films`; some may be missing.

    Raises:
        RuleError: There is none to draw from, or one does not belong to a film.
    """
    given = dict(backdrops.items) if backdrops is not None else {}
    if backdrop is not None:
        given[PICTURE] = backdrop
    if bool(given) != bool(swap):
        message = "`swap` needs a `backdrop` to draw from" if swap else "a `backdrop` is given, but `swap` is 0"
        raise _refused(message, "`swap: 0.5` and `backdrop: $backdrop`, of demonstrate.backdrop")
    keys = {_key(part, camera) for part in parts for camera in part.films}
    if lost := sorted(given.keys() - keys):
        raise _refused(
            f"there is no film of `{lost[0]}`, to which a backdrop is given", f"films: {listing(sorted(keys))}"
        )
    found = []
    for part in parts:
        own = {camera: given[key] for camera in part.films if (key := _key(part, camera)) in given}
        for camera, each in own.items():
            _check(part, camera, each)
        found.append(replace(part, backdrops=own))
    return found


def _key(part: Part, camera: str) -> str:
    """The key of a film of a part among `films`; that of the only film of one set is the camera."""
    if part.label == ALONE:
        return camera
    return part.label if camera == PICTURE else f"{part.label}.{camera}"


def _check(part: Part, camera: str, backdrop: Backdrop) -> None:
    film = part.films[camera]
    size = (film.height, film.width)
    lost = [name for name in part.episodes.items if name not in backdrop.masks]
    lengths = dict(zip(part.episodes.items, part.lengths, strict=True))
    rows = (film.height, -(-film.width // 8))
    if (
        lost
        or backdrop.pictures.shape[1:3] != size
        or any(backdrop.masks[name].shape != (steps, *rows) for name, steps in lengths.items())
    ):
        raise _refused(
            f"the backdrop of `{_key(part, camera)}` is not that of its film",
            "give demonstrate.backdrop the episodes and the view of the film",
        )


def _refused(message: str, hint: str) -> RuleError:
    return RuleError(message, code="DXB-B534", hint=hint)
