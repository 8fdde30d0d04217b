"""Pixels that are removed from the photograph."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.geometry import regions

from .layers import plain_colour

SHADE = (0.4, 1.15)
"""A shadow or a reflection on the support changes its brightness by a factor in this range."""
TINT = 0.15
"""It changes the ratio of a colour to the brightness by less than this."""
SPECK = 0.005
"""Narrower regions are no separate object, as a fraction of the width."""
LEAST = 0.001
"""Smaller regions are none either, as a fraction of the picture."""


def hole(instances: InstanceMap, robot: np.ndarray, part: float) -> np.ndarray:
    """Pixels (H, W) of objects and of the robot (H, W), dilated by a fraction of the width.

    Inner gaps, such as the opening of a handle, are part of it.
    """
    mask = (instances.labels > 0) | robot
    radius = max(1, round(part * mask.shape[1]))
    outside = np.pad(~mask, 1, constant_values=True)
    mask = np.pad(mask, 1) | ~regions.largest(outside)
    mask = mask[1:-1, 1:-1]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc) > 0)


def shaded(pixels: np.ndarray, level: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Pixels (H, W) with the colour of the support around them, except for a shadow or a reflection.

    Other colours next to an object belong to something else, such as a sheet of paper or another magazine.

    Args:
        pixels: (H, W, 3) uint8 photograph.
        level: (H, W) pixels measured as support, away from removed pixels.
        taken: (H, W) removed pixels.
    """
    small = plain_colour(pixels, level)
    if small is None:
        return np.ones_like(level)
    plain = cv2.resize(small, level.shape[::-1], interpolation=cv2.INTER_LINEAR)
    ratio = (cv2.blur(pixels, (5, 5)).astype(np.float32) + 4.0) / (plain + 4.0)
    light = ratio.mean(axis=-1)
    same = (np.abs(ratio - light[..., None]) < TINT * np.maximum(light, 0.5)[..., None]).all(axis=-1)
    same &= (light > SHADE[0]) & (light < SHADE[1])
    side = max(3, round(SPECK * level.shape[1])) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    other = cv2.morphologyEx((~same & ~taken).astype(np.uint8), cv2.MORPH_OPEN, disc)
    _, labels, facts, _ = cv2.connectedComponentsWithStats(other, connectivity=4)
    large = facts[:, cv2.CC_STAT_AREA] >= LEAST * level.size
    large[0] = False
    same = ~large[labels]
    # A patterned support has no uniform colour to compare with.
    return np.asarray(same) if same[level].mean() > 0.5 else np.ones_like(level)


MOSTLY_BLANK = 0.8
"""Fraction of a region's pixels without depth above which it is a shiny or dark part of its neighbour."""
SCRAP = 0.8
"""Fraction of a region's pixels close to a mask from which it is a scrap of something larger."""


def remnants(other: np.ndarray, wide: np.ndarray, flat: np.ndarray, blank: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of objects that their masks have missed.

    Args:
        other: (H, W) pixels next to the masks that do not have the support's colours.
        wide: (H, W) the masks and their surroundings.
        flat: (H, W) pixels measured in the support's plane.
        blank: (H, W) pixels without depth.
    """
    _, labels = cv2.connectedComponents(other.astype(np.uint8), connectivity=4)
    size = np.maximum(np.bincount(labels.reshape(-1)), 1)
    near, low, void = (np.bincount(labels[mask], minlength=len(size)) / size for mask in (wide, flat, blank))
    found = (near > np.where(void > MOSTLY_BLANK, 0.25, 0.5)) & (low < 0.5)
    found[0] = False
    return np.asarray(found[labels])


def scraps(other: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of highlights, rims and sheets of which hardly more is in view than what is next to the masks.

    Even if they are level with the support: alone in the filled surface, they would look like torn paper. The arguments
    are those of `remnants`.
    """
    _, labels = cv2.connectedComponents(other.astype(np.uint8), connectivity=4)
    near = np.bincount(labels[wide], minlength=labels.max() + 1) / np.maximum(np.bincount(labels.reshape(-1)), 1)
    found = near > SCRAP
    found[0] = False
    return np.asarray(found[labels])
