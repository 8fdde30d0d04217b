"""What the panel of `dxb view` does with the objects of a twin: names, corrections, and a build with them."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.errors import UsageError
from dextera_build.geometry import pictures
from dextera_build.session import Session

Point = tuple[int, int]


class Mending:
    """Names and corrects the objects that are shown; see `view.chosen.Mending`.

    Args:
        session: The recipe as it is shown.
        photograph: Its photograph.
        objects: The objects in it, under their final names.
        show: Shows a session's scene in the viewer, in place of the one that is there.
    """

    def __init__(
        self, session: Session, photograph: Photograph, objects: Segmentation, show: Callable[[Session], None]
    ) -> None:
        self._session, self._objects, self._show = session, objects, show
        self._photograph = pictures.digest_of(photograph.rgb.pixels)
        self._request: Session | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The objects in the photograph."""
        return self._objects.names

    def mask(self, name: str) -> np.ndarray:
        """The pixels (H, W) bool of an object."""
        return self._objects.mask(name)

    def bind(self, label: str, name: str) -> str:
        """Bind a name to an object by its innermost pixel, as `dxb bind` does."""
        from dextera_build.building.bind import Naming
        from dextera_build.building.values import raise_errors
        from dextera_build.recipe.bindings import Binding

        recipe = self._session.recipe
        if label not in self.names:
            raise UsageError(f"`{label}` is no object of the photograph", code="DXB-U216")
        at = pictures.innermost(self.mask(label))
        naming = Naming(self._session.project, recipe)
        raise_errors(naming.prepare(lambda _: None))
        naming.bind(name, Binding((int(at[0]), int(at[1]))), on=self._photograph)
        return f"`{name}` is bound in dxb.lock; `dxb build {recipe}` renames it"

    def merge(self, label: str, other: str) -> str:
        """Make two objects one in the `scene.yaml`."""
        return self._correct(lambda corrections: corrections.merge(label, other))

    def split(self, label: str, points: Sequence[Point]) -> str:
        """Make an object two in the `scene.yaml`, with a pixel of each part."""
        return self._correct(lambda corrections: corrections.split(label, points))

    def rebuild(self, say: Callable[[str], None]) -> str:
        """Build with the corrections, and show the new scene in place of the one that is there."""
        from dextera_build.building.corrections import rebuild
        from dextera_build.runs.events import NodeFinished, NodeStarted

        done = 0

        def hear(event: object) -> None:
            nonlocal done
            done += isinstance(event, NodeFinished)
            if isinstance(event, NodeStarted):
                say(f"{done} nodes are up to date; `{event.node}` runs")

        session = self._asked()
        rebuild(session, hear)
        self._show(Session(session.project, session.recipe, session.added))
        return ""

    def _asked(self) -> Session:
        if self._request is None:
            self._request = request_of(self._session)
        return self._request

    def _correct(self, correct: Callable[[Any], Any]) -> str:
        from dextera_build.building.corrections import Corrections, words

        session = self._asked()
        made = correct(Corrections(session, self._photograph))
        self._request = Session(session.project, session.recipe, made.added, makes=True)
        lines = "\n".join(f"* {line}" for line in made.lines)
        command = shlex.join(["dxb", *words(self._request, made.added)])
        return (
            f"Written to `{made.file}`:\n\n{lines}\n\nObjects are now {', '.join(made.objects)}. "
            f"**Rebuild** builds and shows them, as `{command}` does."
        )


def request_of(session: Session) -> Session:
    """A session that builds the request that `session` shows: its own, or the last one that was built.

    Raises:
        UsageError: The last request is not known any more.
    """
    from dextera_build.cli import options
    from dextera_build.runs import log

    asked, run = Session(session.project, session.recipe, session.added, makes=True), session.last_run()
    if session.variant == asked.variant or run is None:
        return asked
    began = (event for event in log.read(session.store, run) if event["event"] == "run_started")
    said: list[Any] = next(began, {}).get("argv", [])
    parser = argparse.ArgumentParser(add_help=False, exit_on_error=False)
    options.project_arguments(parser)
    options.request_arguments(parser)
    args, _ = parser.parse_known_args([str(word) for word in said])
    found = Session(options.project(args), session.recipe, options.added(args), makes=True)
    if found.variant != session.variant:
        raise UsageError(
            "the view shows a request whose inputs are not known here",
            code="DXB-U225",
            facts={"request": session.variant[1:]},
            hint=f"open it with its inputs: `dxb view {session.recipe} --input NAME=PATH`",
        )
    return found
