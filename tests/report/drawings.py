"""Pictures for the fabricated run."""

from __future__ import annotations

import functools
import io

from PIL import Image, ImageDraw, ImageFilter

LABELS = ("laptop", "blue_mug", "box", "gray_bowl")
COLOURS = {"laptop": (92, 96, 104), "blue_mug": (52, 92, 168), "box": (186, 122, 64), "gray_bowl": (150, 152, 150)}
SHAPES = {
    "laptop": [(90, 300), (360, 280), (400, 400), (120, 430)],
    "blue_mug": [(470, 290), (570, 290), (562, 405), (478, 405)],
    "box": [(620, 250), (760, 262), (752, 410), (616, 392)],
    "gray_bowl": [(790, 340), (930, 340), (895, 420), (825, 420)],
}


@functools.cache
def scene(*, only: str = "", wire: bool = False, tint: bool = False) -> bytes:
    """A drawn table with four things on it, or one of them alone, as PNG."""
    width, height = 960, 540
    image = Image.new("RGB", (width, height), (246, 246, 247) if only else (214, 210, 204))
    draw = ImageDraw.Draw(image)
    if not only:
        draw.polygon([(0, height), (0, 300), (width, 240), (width, height)], fill=(142, 108, 78))
        for i in range(0, width, 46):
            draw.line([(i, 300 - i * 0.06), (i - 120, height)], fill=(132, 99, 70), width=3)
    for name in [only] if only in SHAPES else SHAPES:
        thing(draw, name, wire=wire, tint=tint)
    if only in SHAPES:
        image = image.crop((min(p[0] for p in SHAPES[only]) - 30, 110, max(p[0] for p in SHAPES[only]) + 30, 450))
    return png(image.filter(ImageFilter.GaussianBlur(0.8)))


def thing(draw: ImageDraw.ImageDraw, name: str, *, wire: bool, tint: bool) -> None:
    """Draw one object."""
    points = SHAPES[name]
    red, green, blue = COLOURS[name]
    if name == "laptop":
        draw.polygon([(90, 300), (360, 280), (345, 130), (80, 148)], fill=(40, 44, 52))
        draw.polygon([(102, 288), (348, 270), (334, 142), (92, 158)], fill=(70, 110, 160))
    draw.polygon(points, fill=(red, green, blue))
    (left, top), (right, _) = points[0], points[1]
    draw.ellipse([left, top - 14, right, top + 14], fill=(red + 25, green + 25, blue + 25))
    for i in range(left - 10, right + 60, 14) if wire else ():
        draw.line([(i, 120), (i + 30, 440)], fill=(255, 255, 255), width=1)
    if tint:
        draw.line([*points, points[0]], fill=(0, 220, 150), width=4)


@functools.cache
def masks() -> bytes:
    """The label map of `scene`."""
    image = Image.new("RGB", (960, 540), (18, 20, 24))
    draw = ImageDraw.Draw(image)
    draw.polygon([(90, 300), (80, 148), (345, 130), (400, 400), (120, 430)], fill=(232, 126, 60))
    draw.polygon([(470, 285), (570, 285), (562, 405), (478, 405)], fill=(70, 150, 240))
    draw.polygon([(620, 250), (760, 262), (752, 410), (616, 392)], fill=(120, 200, 90))
    draw.polygon([(790, 340), (930, 340), (895, 420), (825, 420)], fill=(200, 90, 190))
    return png(image)


def png(image: Image.Image) -> bytes:
    """PNG bytes."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    return buffer.getvalue()
