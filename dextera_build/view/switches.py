"""Check boxes that show and hide parts of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dextera_build.view.figure import Figure
from dextera_build.view.panel import note_switch


def switch(server: Any, title: str, handles: Iterable[Any], *, visible: bool) -> None:
    """A check box for some scene nodes."""
    box = server.gui.add_checkbox(title, initial_value=visible)
    switched = list(handles)
    note_switch(server, title, switched, visible=visible)

    def toggle(_: object) -> None:
        for handle in switched:
            handle.visible = box.value

    box.on_update(toggle)


def switches(server: Any, figure: Figure) -> None:
    """Check boxes for the parts of a model."""
    objects = [handle for handles in figure.surfaces.values() for handle in handles]
    with server.gui.add_folder("Show"):
        for title, handles, visible in (
            ("Labels", figure.labels, True),
            ("Objects", objects, True),
            ("Robot", figure.robot, True),
            ("Background", figure.static, True),
            ("Collision pieces", figure.pieces, False),
        ):
            if handles:
                switch(server, title, handles, visible=visible)
