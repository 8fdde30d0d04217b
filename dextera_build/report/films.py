"""Films in data URIs: those of episodes as H.264, whose encoder is an extra, and results that are MP4 files already."""

from __future__ import annotations

import base64
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

from dextera_build.errors import DxbError
from dextera_build.report.html import Html, tag
from dextera_build.report.sources import Store, blob, header

QP = 26
"""Quantisation of films in reports."""
MOST_STEPS = 1200
"""Longer films are cut: a minute at 20 Hz."""
MOST_BYTES = 1_500_000
"""Larger MP4 files are left out."""


class Films:
    """Films of a store; each is encoded once.

    Args:
        store: Where their frames are.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._made: dict[tuple[str, float], str] = {}

    def uri(self, fields: dict[str, Any], rate_hz: float) -> tuple[str, str]:
        """Index and data URI of the first episode of a `Film`, by its header; two empty texts if there is none."""
        frames = fields.get("frames")
        found = frames.get("$map", {}) if isinstance(frames, dict) else {}
        index = min(found, key=lambda name: (len(name), name), default="")
        if not index:
            return "", ""
        digest = str(found[index]["$bytes"][0])
        if (digest, rate_hz) not in self._made:
            packed = blob(self._store, digest)
            size = int(fields["width"]), int(fields["height"])
            self._made[digest, rate_hz] = "" if packed is None else _encoded(packed, *size, rate_hz)
        return (index, self._made[digest, rate_hz]) if self._made[digest, rate_hz] else ("", "")

    def mp4(self, fields: dict[str, Any]) -> str:
        """Data URI of a `Video`, by its header; empty for other files than MP4, and for large ones."""
        file = fields.get("file")
        _, stored = header(self._store, file.get("$ref") if isinstance(file, dict) else None)
        digest, size = (stored.get("data") or {}).get("$bytes", ("", 0))
        data = blob(self._store, digest) if 0 < size <= MOST_BYTES else None
        return _uri(data) if data is not None and data[4:8] == b"ftyp" else ""


def player(source: str, about: str, width: int = 0) -> Html:
    """A film that plays by itself, without sound, over and over.

    Args:
        source: Data URI.
        about: What it shows.
        width: Of its frames [px], of which it is shown at most twice as wide; 0: as wide as there is room.
    """
    held = {"style": f"max-width:{2 * width}px"} if width else {}
    plays = {"controls": True, "autoplay": True, "loop": True, "muted": True, "playsinline": True}
    return tag("video", {"src": source, **plays, "aria-label": about, **held})


def _encoded(packed: bytes, width: int, height: int, rate_hz: float) -> str:
    from itertools import islice

    from dextera_build.artifacts.tasks.episode import Film
    from dextera_build.formats.h264 import Encoder

    even = width // 2 * 2, height // 2 * 2
    encoder = Encoder(*even, rate=Fraction(rate_hz).limit_denominator(1000), qp=QP, keyframe_every=20)
    film = Film(frames={"0": packed}, width=width, height=height)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        try:
            encoder.write(path, (frame[: even[1], : even[0]] for frame in islice(film.each("0"), MOST_STEPS)))
        except (DxbError, ImportError):  # damaged, or PyAV is not installed
            return ""
        return _uri(path.read_bytes())


def _uri(data: bytes) -> str:
    return f"data:video/mp4;base64,{base64.b64encode(data).decode()}"
