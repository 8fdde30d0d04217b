"""Check that a film matches its episodes."""

from __future__ import annotations

from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.rule import Context


def check_film(ctx: Context, episodes: Episodes, film: Film | None) -> None:
    """Reject a film that lacks an episode.

    Raises:
        RuleError: An episode is missing.
    """
    missing = sorted(set(episodes.items) - set(film.frames)) if film is not None else []
    if missing:
        ctx.fail(
            "the film does not show every episode",
            hint="film these episodes with demonstrate.film",
            missing=f"{len(missing)} of {len(episodes.items)}",
            first=missing[0],
        )
