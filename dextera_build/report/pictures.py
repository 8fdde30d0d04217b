"""Pictures as data URIs, small enough for one file: scaled down and compressed again."""

from __future__ import annotations

import base64
import io
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from dextera_build.report import sources
from dextera_build.report.html import Html, tag
from dextera_build.report.sources import Store

Size: TypeAlias = Literal["hero", "large", "small"]
Told: TypeAlias = Callable[[int, int], None]
"""Takes the numbers of pictures that are compressed, and of all."""


@dataclass(frozen=True)
class Quality:
    """Size and compression of pictures."""

    hero: int
    """Longest side of the picture at the top [px]."""
    large: int
    """Longest side in cards [px]."""
    small: int
    """Longest side of thumbnails [px]."""
    webp: int
    """WebP quality, 0..100."""


LADDER = (
    Quality(1400, 900, 440, 84),
    Quality(1100, 640, 260, 74),
    Quality(900, 420, 180, 60),
    Quality(640, 240, 96, 45),
)
"""From fine to coarse: the report takes the first that fits its size."""


_DAMAGED = (OSError, SyntaxError, ValueError)
"""What Pillow raises on damaged pictures."""
_MOST_PIXELS = 50_000_000
"""Larger pictures are left out before they are decoded."""


class Pictures:
    """Pictures of the store at one quality; each is decoded and compressed once per size.

    Args:
        store: Where they are.
        quality: Their size and compression.
        count: Number of pictures of the page, for `told`.
        told: Called after each picture.
    """

    def __init__(self, store: Store, quality: Quality, count: int = 0, told: Told | None = None) -> None:
        self._store, self._quality = store, quality
        self._count, self._told = count, told
        self._made: dict[tuple[str, Size], tuple[str, int, int] | None] = {}
        self.large: set[str] = set()
        """Digests of pictures that the page shows larger than a thumbnail."""

    def begin(self) -> None:
        """Start another page with the same pictures."""
        self.large.clear()

    def figure(
        self,
        digest: str,
        caption: str,
        *,
        size: Size = "large",
        note: str = "",
        name: str = "",
        simulated: bool = False,
    ) -> Html:
        """A figure with its caption, or nothing if the store has no such picture.

        Args:
            digest: Of a PNG.
            caption: Shown below.
            size: `hero`, `large` or `small`.
            note: The origin of the picture, shown before the caption.
            name: Node address, for the alternative text.
            simulated: Whether a simulation replaces the hardware that it shows, which a label then says.
        """
        made = self.uri(digest, size)
        if made is None:
            return Html("")
        if size != "small":
            self.large.add(digest)
        uri, width, height = made
        alt = f"{caption or 'picture'} of {name}" if name else caption or "picture"
        image = tag("img", {"src": uri, "alt": alt, "width": width, "height": height, "data-picture": digest[:16]})
        button = tag("button", {"type": "button", "class": "zoom", "aria-label": f"enlarge: {alt}"}, image)
        label = [tag("span", {"class": "simulated"}, "simulated"), " "] if simulated else None
        words = tag("figcaption", None, label, tag("b", None, note) if note else None, " " if note else None, caption)
        shape = {"class": f"picture {size}", "style": f"--ratio:{width / height:.3f}"}
        return tag("figure", shape, button, words if note or caption or label else None)

    def uri(self, digest: str, size: Size) -> tuple[str, int, int] | None:
        """Data URI, width and height [px]; None if the store has no such picture."""
        if (digest, size) not in self._made:
            self._made[digest, size] = self._make(digest, getattr(self._quality, size))
            if self._told is not None:
                self._told(len(self._made), self._count)
        return self._made[digest, size]

    def _make(self, digest: str, side: int) -> tuple[str, int, int] | None:
        from PIL import Image

        raw = sources.blob(self._store, digest)
        try:
            opened = None if raw is None else _opened(raw)
            if opened is None:
                return None
            picture = opened.convert("RGBA" if "A" in opened.getbands() else "RGB")
        except _DAMAGED:
            return None
        picture.thumbnail((side, side), Image.Resampling.LANCZOS)
        buffer = io.BytesIO()
        picture.save(buffer, format="WEBP", quality=self._quality.webp, method=4)
        data = base64.b64encode(buffer.getvalue()).decode()
        return f"data:image/webp;base64,{data}", picture.width, picture.height


class Sketch(Pictures):
    """Counts the pictures of a page, which has none then."""

    def __init__(self, store: Store) -> None:
        super().__init__(store, LADDER[0])
        self.wanted: Counter[tuple[str, Size]] = Counter()
        """Digest and size of each picture -> how often the page holds it."""

    def uri(self, digest: str, size: Size) -> tuple[str, int, int] | None:
        """An empty address, and the size of the picture as it is stored [px]."""
        if (digest, size) not in self._made:
            self._made[digest, size] = self._look(digest)
        if self._made[digest, size] is not None:
            self.wanted[digest, size] += 1
        return self._made[digest, size]

    def _look(self, digest: str) -> tuple[str, int, int] | None:
        raw = sources.blob(self._store, digest)
        try:
            opened = None if raw is None else _opened(raw)
        except _DAMAGED:
            return None
        return None if opened is None else ("", opened.width, opened.height)


def _opened(raw: bytes) -> Any:
    """A picture that is not decoded yet; None if it is too large."""
    from PIL import Image

    try:
        # PNG only: Pillow's other readers may run programs (EPS runs Ghostscript).
        opened = Image.open(io.BytesIO(raw), formats=("PNG",))
    except Image.DecompressionBombError:
        return None
    return opened if opened.width * opened.height <= _MOST_PIXELS else None


def from_header(store: Store, kind: str, fields: dict[str, Any]) -> bytes | None:
    """PNG of an `Image` artifact's pixels, or None for other types."""
    form = fields.get("pixels")
    if kind != "Image" or not isinstance(form, dict) or "$array" not in form:
        return None
    dtype, shape, digest = form["$array"]
    raw = sources.blob(store, digest)
    if raw is None or dtype != "uint8" or len(shape) != 3 or len(raw) != shape[0] * shape[1] * 3:
        return None
    from PIL import Image

    buffer = io.BytesIO()
    Image.frombytes("RGB", (shape[1], shape[0]), raw).save(buffer, format="PNG")
    return buffer.getvalue()
