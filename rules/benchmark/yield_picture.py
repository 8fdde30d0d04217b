"""The picture of yields by demonstration: bars of attempts, divided into kept ones and those lost in a segment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

KEPT = (58, 110, 165)
LOST = ((214, 120, 46), (170, 70, 90), (120, 90, 160), (186, 160, 60), (90, 130, 130), (150, 110, 90), (110, 110, 110))
INK, PAPER = (40, 44, 52), (255, 255, 255)
ROW_PX, BAR_PX, LEFT_PX, WIDE_PX, TEXT_PX = 22, 16, 110, 420, 13


def yield_picture(
    names: Sequence[str], kept: Mapping[str, int], lost: Mapping[str, Mapping[str, int]], segments: Sequence[str]
) -> np.ndarray:
    """The picture (H, W, 3) uint8.

    Args:
        names: Demonstrations, from top to bottom.
        kept: Demonstration -> attempts that succeeded.
        lost: Demonstration -> segment -> attempts that ended in it.
        segments: Segments in the order of their colours.
    """
    font = ImageFont.load_default(TEXT_PX)
    picture = Image.new("RGB", (LEFT_PX + WIDE_PX + 50, ROW_PX * (len(names) + 2)), PAPER)
    pen = ImageDraw.Draw(picture)
    colours = {"kept": KEPT, **{name: LOST[number % len(LOST)] for number, name in enumerate(segments)}}
    x = 8.0
    for label, colour in colours.items():
        pen.rectangle([x, 6, x + 10, 16], fill=colour)
        pen.text((x + 14, 3), label, fill=INK, font=font)
        x += 26 + pen.textlength(label, font=font)
    parts = {name: [kept.get(name, 0), *(lost[name].get(each, 0) for each in segments)] for name in names}
    most = max((sum(counts) for counts in parts.values()), default=1)
    for row, (name, counts) in enumerate(parts.items(), start=1):
        top, left = ROW_PX * row + 3, float(LEFT_PX)
        pen.text((8, top), name, fill=INK, font=font)
        for count, colour in zip(counts, colours.values(), strict=True):
            right = left + WIDE_PX * count / max(most, 1)
            if count:
                pen.rectangle([left, top, right, top + BAR_PX], fill=colour)
            left = right
        pen.text((left + 6, top), str(sum(counts)), fill=INK, font=font)
    return np.array(picture, np.uint8)
