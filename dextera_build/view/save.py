"""One file to share: the scene, and the episode that is shown, as viser's recording or as a page that plays it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dextera_build.errors import UsageError
from dextera_build.view import panel

SUFFIXES = (".html", ".viser")
"""`.html` is the recording with viser's player in it, and needs nothing but a browser."""


def check(path: Path) -> None:
    """Refuse files of other kinds.

    Raises:
        UsageError: The name ends in none of `SUFFIXES`.
    """
    if path.suffix not in SUFFIXES:
        raise UsageError(
            f"`{path.name}` is not a file that the viewer writes",
            code="DXB-U323",
            facts={"endings": ", ".join(SUFFIXES)},
            hint="`.html` opens in any browser, offline; `.viser` is the recording alone, for viser's player",
        )


def write(server: Any, path: Path, steps: Iterable[float] = ()) -> Path:
    """Write the server's scene to `path` and return it.

    Args:
        server: From `view.server.start`.
        path: A file with one of `SUFFIXES`.
        steps: Moves the scene on with every item, which is the time that the state before it lasts [s]; left out of a
            page whose sliders move a robot.
    """
    check(path)
    if path.suffix == ".html" and panel.has_robot(server):
        steps = ()
    recorder = server.get_scene_serializer()
    moves = False
    for seconds in steps:
        recorder.insert_sleep(seconds)
        moves = True
    path.parent.mkdir(parents=True, exist_ok=True)
    data = _page(server, recorder, moves=moves) if path.suffix == ".html" else recorder.serialize()
    draft = path.with_name(f".{path.name}.part")
    draft.write_bytes(data)
    draft.replace(path)
    return path


def _page(server: Any, recorder: Any, *, moves: bool) -> bytes:
    """The page of a recording, with the panel of the viewer's controls."""
    return panel.inserted(recorder.as_html(), panel.script(server, moves=moves)).encode()
