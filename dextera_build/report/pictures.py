"""Pictures as data URIs, small enough for one file: scaled down and compressed again."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

from dextera_build.report import sources
from dextera_build.report.html import Html, tag
from dextera_build.report.sources import Store


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


_MOST_PIXELS = 50_000_000
"""Larger pictures are left out before they are decoded."""


class Pictures:
    """Pictures of the store at one quality; each is decoded and compressed once per size."""

    def __init__(self, store: Store, quality: Quality) -> None:
        self._store = store
        self._quality = quality
        self._made: dict[tuple[str, int], tuple[str, int, int] | None] = {}
        self.large: set[str] = set()
        """Digests of pictures that the page shows larger than a thumbnail."""

    def figure(
        self,
        digest: str,
        caption: str,
        *,
        size: str = "large",
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
        made = self.uri(digest, int(getattr(self._quality, size)))
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

    def uri(self, digest: str, side: int) -> tuple[str, int, int] | None:
        """Data URI, width and height [px] with the longest side at most `side`."""
        if (digest, side) not in self._made:
            self._made[digest, side] = self._make(digest, side)
        return self._made[digest, side]

    def _make(self, digest: str, side: int) -> tuple[str, int, int] | None:
        raw = sources.blob(self._store, digest)
        if raw is None:
            return None
        from PIL import Image

        try:
            # PNG only: Pillow's other readers may run programs (EPS runs Ghostscript).
            with Image.open(io.BytesIO(raw), formats=("PNG",)) as opened:
                if opened.width * opened.height > _MOST_PIXELS:
                    return None
                picture = opened.convert("RGBA" if "A" in opened.getbands() else "RGB")
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
            return None
        picture.thumbnail((side, side), Image.Resampling.LANCZOS)
        buffer = io.BytesIO()
        picture.save(buffer, format="WEBP", quality=self._quality.webp, method=4)
        data = base64.b64encode(buffer.getvalue()).decode()
        return f"data:image/webp;base64,{data}", picture.width, picture.height


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
