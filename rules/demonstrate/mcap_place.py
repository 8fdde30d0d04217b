"""Topics of terms in recordings."""

from __future__ import annotations

from dextera_build.policy.terms import Declared


def place(term: Declared, picture: str) -> str:
    """Topic of a term, `{}` for a row or the camera; `picture` is the encoding of the pictures."""
    return "/{}/color/video" if term.name == "rgb" and picture == "h264" else term.topic
