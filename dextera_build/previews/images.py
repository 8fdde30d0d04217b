"""Pictures of images and masks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import DepthImage, Image, LabelImage, faded, png, smaller
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.view import InstanceMap, ObjectView


def _picture_of_image(image: Image) -> bytes:
    """The picture itself; a large one is subsampled by a whole factor."""
    return png(smaller(image.pixels))


def grey(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) as (H, W) uint8: near is bright, black where nothing was measured."""
    there = depth > 0
    near, far = (depth[there].min(), depth[there].max()) if there.any() else (0.0, 1.0)
    return np.where(there, 255 - 195 * (depth - near) / max(far - near, 1e-6), 0).astype(np.uint8)


def beside_plot(pixels: np.ndarray) -> np.ndarray:
    """A smaller copy with the height of a plot, (240, W, 3) uint8; white below it."""
    shown = smaller(pixels, 320)[:240]
    framed = np.full((240, shown.shape[1], 3), 255, np.uint8)
    framed[: len(shown)] = shown
    return framed


def _picture_of_depth_image(image: DepthImage) -> bytes:
    return png(smaller(grey(image.depth)))


def _picture_of_labels(found: LabelImage | InstanceMap) -> bytes:
    """One colour for each instance, black for the background."""
    hues = np.array([(0, 0, 0), (230, 85, 60), (60, 140, 220), (90, 180, 90), (235, 170, 50), (150, 105, 200)])
    return png(smaller(hues[np.where(found.labels > 0, (found.labels - 1) % 5 + 1, 0)].astype(np.uint8)))


def _picture_of_object_view(view: ObjectView) -> bytes:
    """The object on a pale copy of its surroundings."""
    return png(smaller(faded(view.rgb.pixels, view.mask), 640))


def _facts_of_panorama(panorama: Panorama) -> Iterator[str]:
    """Size, the fraction of seen pixels, and the frame."""
    height, width = panorama.image.pixels.shape[:2]
    yield f"{width} x {height} px"
    if panorama.seen is not None:
        yield f"{panorama.seen.mean():.0%} seen"
    yield f"frame {panorama.pose.parent}"


def _picture_of_panorama(panorama: Panorama) -> bytes:
    """The picture itself, smaller."""
    return _picture_of_image(panorama.image)


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    Panorama: _facts_of_panorama,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    Image: _picture_of_image,
    DepthImage: _picture_of_depth_image,
    LabelImage: _picture_of_labels,
    ObjectView: _picture_of_object_view,
    InstanceMap: _picture_of_labels,
    Panorama: _picture_of_panorama,
}
