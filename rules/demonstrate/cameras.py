"""The cameras of a data set: what each of them filmed, under which name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import View
from dextera_build.errors import listing
from dextera_build.policy.cameras import NAME
from dextera_build.rule import Context

from .film_of import check_film


@dataclass(frozen=True)
class Camera:
    """One camera of a data set."""

    name: str
    """Its name, which names its pictures."""
    film: Film | None
    """What it saw; None if there are no pictures."""
    view: View | None
    """Its intrinsics and place; None if unknown."""

    @property
    def has_depth(self) -> bool:
        """Whether its pictures have depth."""
        return self.film is not None and bool(self.film.depth)


@dataclass(frozen=True)
class Given:
    """Films and views as a rule gets them: of one camera, or of several by name."""

    film: Film | None = None
    view: View | None = None
    films: Collection[Film] | None = None
    views: Collection[View] | None = None


def checked(ctx: Context, episodes: Episodes, given: Given, name: str) -> tuple[Camera, ...]:
    """The cameras of a data set, in the order of their names; `name` is that of the only one.

    Raises:
        RuleError: Films and views do not go together, or a film does not show every episode.
    """
    found = _single(given, name) if given.films is None and given.views is None else _several(ctx, given)
    for each in found:
        ctx.check(
            NAME.fullmatch(each.name) is not None,
            f"`{each.name}` cannot name a camera",
            hint="take small letters, digits and underscores",
        )
        check_film(ctx, episodes, each.film)
        if each.film is not None and each.view is not None:
            _check_size(ctx, each.name, each.film, each.view)
    return found


def _single(given: Given, name: str) -> tuple[Camera, ...]:
    if given.film is None and given.view is None:
        return ()
    return (Camera(name, given.film, given.view),)


def _several(ctx: Context, given: Given) -> tuple[Camera, ...]:
    single = given.film is not None or given.view is not None
    ctx.check(
        not single, "`film` and `view` are for one camera, `films` and `views` for several", hint="give either of them"
    )
    films: Mapping[str, Film] = {} if given.films is None else given.films.items
    views: Mapping[str, View] = {} if given.views is None else given.views.items
    lost = sorted(views.keys() - films.keys())
    ctx.check(not lost, f"there is no film of camera `{lost[0] if lost else ''}`", films=listing(sorted(films)))
    return tuple(Camera(name, films[name], views.get(name)) for name in sorted(films))


def _check_size(ctx: Context, name: str, film: Film, view: View) -> None:
    if (film.width, film.height) != (view.camera.width, view.camera.height):
        ctx.fail(
            "the film was not shot through this view",
            camera=name,
            film=f"{film.width} x {film.height} px",
            view=f"{view.camera.width} x {view.camera.height} px",
        )
