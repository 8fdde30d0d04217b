"""Names of pictures in RLDS."""

from __future__ import annotations

PICTURE, DEPTH = "image", "depth"
"""Names of the pictures and the depth of the only camera among the observations."""


def key(kind: str, several: bool) -> str:
    """Name of pictures among the observations, of kind `PICTURE` or `DEPTH`; `{}` is one of several cameras."""
    return f"{{}}_{kind}" if several else kind
