"""Comparison pictures: labelled panels, blends and outlines."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

GAP = 6
SMALLEST_PX, SHOWN_PX, READ_PX = 15, 760, 13
"""Lettering: at least so high; a board is shown about so wide in a report, where it has to be so high."""
PAPER, INK = (250, 250, 250), (40, 44, 52)


def board(
    photo: np.ndarray,
    twin: np.ndarray,
    owner: np.ndarray,
    names: tuple[str, ...],
    blend: float,
    sides: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Two by two labelled panels of one camera, and below them those from other sides, two in a row.

    Args:
        photo: (H, W, 3) uint8 photograph.
        twin: (H, W, 3) uint8 render.
        owner: (H, W) int32, index into `names` of the object in each pixel of the render, or -1.
        names: Object names.
        blend: Weight of the render in the blended panel.
        sides: Name of the side -> render of the same size; an even number.
    """
    mixed = np.round(photo * (1.0 - blend) + twin * blend).astype(np.uint8)
    size = lettering(2 * photo.shape[1])
    traced = outlined(photo, owner, names, size)
    panels = [("photograph", photo), ("twin", twin), (f"{blend:.0%} twin over photograph", mixed)]
    panels.append(("outlines of the twin on the photograph", traced))
    panels += [(f"twin from {where}", side) for where, side in sides.items()]
    panes = [titled(pixels, title, size) for title, pixels in panels]
    whole = beside(panes[0], panes[1], axis=1)
    for left, right in zip(panes[2::2], panes[3::2], strict=True):
        whole = beside(whole, beside(left, right, axis=1), axis=0)
    return np.pad(whole, ((GAP, GAP), (GAP, GAP), (0, 0)), constant_values=PAPER[0])


def lettering(width: int) -> int:
    """Height of letters [px] in a picture of this width, so that they are read in a report."""
    return max(SMALLEST_PX, -(-width * READ_PX // SHOWN_PX))


def outlined(photo: np.ndarray, owner: np.ndarray, names: tuple[str, ...], size: int = SMALLEST_PX) -> np.ndarray:
    """The photograph with each object's outline, two pixels wide, and its name in letters of `size` [px]."""
    from PIL import Image, ImageDraw

    pixels = photo.copy()
    spots = []
    for number, name in enumerate(names):
        mask = owner == number
        if not mask.any():
            continue
        colour = _colour(number)
        pixels[spread(mask) & spread(~mask)] = colour
        rows, columns = np.nonzero(mask)
        spots.append((name, float(columns.mean()), float(rows.min()), colour))
    picture = Image.fromarray(pixels)
    pen = ImageDraw.Draw(picture)
    font = typeface(size)
    for name, x, y, colour in spots:
        width = pen.textlength(name, font=font)
        left = min(max(2.0, x - width / 2), photo.shape[1] - width - 4)
        top = max(2.0, y - 1.5 * size)
        pen.rectangle([left - 3, top - 1, left + width + 3, top + 1.2 * size], fill=colour)
        pen.text((left, top), name, fill=(255, 255, 255), font=font)
    return np.array(picture, np.uint8)


def spread(mask: np.ndarray) -> np.ndarray:
    """Dilate a (H, W) mask by one pixel in all eight directions."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    shifts = [padded[row : row + height, column : column + width] for row in range(3) for column in range(3)]
    return np.asarray(np.logical_or.reduce(shifts))


def _colour(number: int) -> tuple[int, int, int]:
    """Well separated hues, the golden angle apart."""
    red, green, blue = colorsys.hsv_to_rgb((0.92 + number * 0.381966) % 1.0, 0.85, 0.85)
    return round(red * 255), round(green * 255), round(blue * 255)


def titled(pixels: np.ndarray, title: str, size: int = SMALLEST_PX) -> np.ndarray:
    """Add a line of text, `size` high [px], above the picture."""
    from PIL import Image, ImageDraw

    bar = round(1.75 * size)
    picture = Image.new("RGB", (pixels.shape[1], pixels.shape[0] + bar), PAPER)
    picture.paste(Image.fromarray(pixels), (0, bar))
    ImageDraw.Draw(picture).text((4, 0.27 * size), title, fill=INK, font=typeface(size))
    return np.array(picture, np.uint8)


def beside(first: np.ndarray, second: np.ndarray, axis: int) -> np.ndarray:
    """Join two pictures along `axis`, with a gap."""
    shape = list(first.shape)
    shape[axis] = GAP
    return np.concatenate([first, np.full(shape, PAPER[0], np.uint8), second], axis=axis)


def typeface(size: int) -> FreeTypeFont | ImageFont:
    """The typeface of all lettering."""
    from PIL import ImageFont

    return ImageFont.load_default(size)
