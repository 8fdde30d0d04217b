"""The controls of a scene, so that a saved page has the same panel without a server.

Each control states what it does to scene nodes; `assets/page.js` does that in the browser.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

_NOTED: WeakKeyDictionary[Any, list[dict[str, Any]]] = WeakKeyDictionary()


def noted(server: Any) -> list[dict[str, Any]]:
    """The controls of a viewer so far."""
    return _NOTED.setdefault(server, [])


def note_switch(server: Any, title: str, handles: Iterable[Any], *, visible: bool) -> None:
    """A check box that shows and hides scene nodes."""
    names = [handle.name for handle in handles]
    noted(server).append({"kind": "switch", "title": title, "names": names, "on": visible})


def note_slider(
    server: Any, title: str, values: Sequence[float], start: float, poses: Mapping[str, Sequence[np.ndarray]]
) -> None:
    """A slider that poses scene nodes.

    Args:
        server: The viewer.
        title: With the unit.
        values: Of the slider, ascending.
        start: Its first value.
        poses: Name of a scene node -> (7,) for each value: position [m], quaternion w, x, y, z.
    """
    moved = {name: [np.round(pose, 6).tolist() for pose in each] for name, each in poses.items()}
    noted(server).append(
        {"kind": "slider", "title": title, "values": [round(v, 3) for v in values], "start": start, "poses": moved}
    )


def note_robot(server: Any, tree: Mapping[str, Any]) -> None:
    """A slider for each joint of a robot; see `kinematic.tree`."""
    noted(server).append({"kind": "robot", **tree})


def has_robot(server: Any) -> bool:
    """Whether the panel moves the joints of a robot."""
    return any(control["kind"] == "robot" for control in noted(server))


def note_wipe(server: Any, title: str, name: str) -> None:
    """A slider that wipes a picture from the right to the left; 0 hides it."""
    noted(server).append({"kind": "wipe", "title": title, "name": name})


def script(server: Any = None, *, moves: bool = False) -> str:
    """The part of a viewer's page that is ours, as an element.

    Args:
        server: Of a saved page, the viewer whose controls its panel has; a page with a server needs none.
        moves: Whether a recording plays in it, over and over.
    """
    code = (resources.files(__package__) / "assets/page.js").read_text(encoding="utf-8")
    controls = [] if server is None else noted(server)
    # `</` would end the element.
    data = json.dumps(controls, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")
    return f"<script>window.dxbControls={data};window.dxbMoves={json.dumps(moves)};\n{code}</script>"


def inserted(page: str, element: str) -> str:
    """A page with one more element at the end of its head."""
    head, end, rest = page.partition("</head>")
    return head + element + end + rest
