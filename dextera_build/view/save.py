"""One file to share: the scene, and the episode that is shown, as a page, as a recording of viser, or for Rerun."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from dextera_build.errors import UsageError
from dextera_build.session import notices
from dextera_build.view import panel, rerun_file
from dextera_build.view.rerun_file import Eye

SUFFIXES = (".html", ".rrd", ".viser")
"""`.html` is the recording with viser's player in it, and needs nothing but a browser."""


def check(path: Path) -> None:
    """Refuse files of other kinds.

    Raises:
        UsageError: The name ends in none of `SUFFIXES`.
        MachineError: It is for Rerun, which is not installed.
    """
    if path.suffix not in SUFFIXES:
        raise UsageError(
            f"`{path.name}` is not a file that the viewer writes",
            code="DXB-U323",
            facts={"endings": ", ".join(SUFFIXES)},
            hint="`.html` opens in any browser, offline; `.rrd` in Rerun; `.viser` is for viser's player",
        )
    if path.suffix == ".rrd":
        rerun_file.check()


def write(server: Any, path: Path, steps: Iterable[float] = (), name: str = "", eyes: Sequence[Eye] = ()) -> Path:
    """Write the server's scene to `path` and return it.

    Args:
        server: From `view.server.start`.
        path: A file with one of `SUFFIXES`.
        steps: See `page`.
        name: What is shown; only `.rrd` holds it, and `eyes`.
        eyes: Cameras with pictures.
    """
    check(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.part")
    if path.suffix == ".html":
        draft.write_text(page(server, steps), encoding="utf-8")
    elif path.suffix == ".viser":
        draft.write_bytes(_recorded(server, steps)[0].serialize())
    elif lacks := _for_rerun(server, draft, steps, name, eyes):
        notices[f"`{path.name}` lacks what Rerun's files of dxb do not hold: {', '.join(lacks)}"] = None
    draft.replace(path)
    return path


def _for_rerun(server: Any, path: Path, steps: Iterable[float], name: str, eyes: Sequence[Eye]) -> list[str]:
    begin = server.initial_camera.position, server.initial_camera.look_at
    return rerun_file.write(_recorded(server, steps)[0].serialize(), path, name, begin, eyes)


def page(server: Any, steps: Iterable[float] = ()) -> str:
    """The server's scene as a page, with the panel of the viewer's controls.

    Args:
        server: From `view.server.start`.
        steps: Moves the scene on with every item, which is the time that the state before it lasts [s]; left out of a
            page whose sliders move a robot.
    """
    recorder, moves = _recorded(server, () if panel.has_robot(server) else steps)
    return panel.inserted(recorder.as_html(), panel.script(server, moves=moves))


def _recorded(server: Any, steps: Iterable[float]) -> tuple[Any, bool]:
    """The recorder of viser after all steps, and whether there were any."""
    recorder = server.get_scene_serializer()
    moves = False
    for seconds in steps:
        recorder.insert_sleep(seconds)
        moves = True
    return recorder, moves
