"""Cameras with pictures of what `dxb view` shows: a twin's photograph, the films of episodes."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import View
from dextera_build.building import fetch
from dextera_build.cli import built
from dextera_build.explain import ancestors
from dextera_build.session import Session
from dextera_build.view.replay import is_asked, titles
from dextera_build.view.rerun_file import Eye


def of(session: Session, node: str, episode: str | None = None) -> list[Eye]:
    """The cameras of a node, or of a recipe if `node` is empty; none if it has no pictures.

    Args:
        session: The recipe.
        node: Its node, or "".
        episode: Index of the episode that is shown; None: the first one.
    """
    nodes = built.by_type(session)
    if not node:
        return [] if built.own_task(session) else list(_photographs(session, nodes))
    return list(_films(session, node, nodes.get("Film", []), episode))


def _photographs(session: Session, nodes: dict[str, list[str]]) -> Iterator[Eye]:
    for taken, placed in zip(nodes.get("Capture", [])[-1:], nodes.get("Support", [])[-1:], strict=False):
        if fetch.bring(session, [taken, placed]):
            continue
        capture, support = session.artifact(taken), session.artifact(placed)
        if isinstance(capture, Capture) and isinstance(support, Support):
            seen = capture.photograph
            yield Eye("photograph", seen.camera, support.camera_pose.matrix, [seen.rgb.pixels])


def _films(session: Session, node: str, films: list[str], asked: str | None) -> Iterator[Eye]:
    """Films of a node's episodes that have the one that is shown."""
    key = session.past(node).key
    for name in films:
        if _episodes_of(session, name) != key or fetch.bring(session, [name, node]):
            continue
        film, episodes = session.artifact(name), session.artifact(node)
        view = next((made for _, made in ancestors.found(session, name, View)), None)
        if not (isinstance(film, Film) and isinstance(episodes, Episodes) and isinstance(view, View)):
            continue
        label = _label(episodes, asked)
        if label in film.frames:
            lens = view.camera.scaled(film.width / view.camera.width)
            yield Eye(name.replace("/", "_"), lens, view.camera_pose.matrix, film.each(label), episodes.rate_hz)


def _episodes_of(session: Session, film: str) -> str:
    """Key of the episodes that a film shows, the nearest ones behind it."""
    return next((event["key"] for kind, event in ancestors.behind(session, film) if kind == Episodes.name()), "")


def _label(episodes: Episodes, asked: str | None) -> str:
    """Index of the episode that the viewer begins with."""
    known = [title.partition(" ")[0] for title in titles(episodes)]
    return next((label for label in known if asked is None or is_asked(label, asked)), "")
