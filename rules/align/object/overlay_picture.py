"""Draw a placed mesh over the photograph."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import raycast, transforms

_LIGHT = np.array([0.3, -0.5, 0.81])


def draw(vertices: np.ndarray, faces: np.ndarray, seen: Seen, placement: Placement) -> np.ndarray:
    """Draw the photograph with the mesh outline on the left, the shaded render on the right; (H, 2 W, 3) uint8."""
    world = transforms.apply(placement.pose.matrix, placement.scale * vertices)
    height, width = seen.mask.shape
    surface = raycast.Surface(world, faces)
    render = raycast.render([surface], seen.camera.matrix(), seen.world_from_camera, height, width)
    drawn = render.index >= 0
    left, right = seen.rgb.copy(), seen.rgb // 3
    left[_edge(seen.mask)] = (60, 130, 246)
    left[_edge(drawn)] = (240, 60, 50)
    shade = 80.0 + 170.0 * np.abs(render.normal @ _LIGHT)
    right[drawn] = shade[drawn][:, None].astype(np.uint8)
    return np.concatenate([left, right], axis=1)


def _edge(mask: np.ndarray) -> np.ndarray:
    """Pixels of a mask with a neighbour outside it."""
    padded = np.pad(mask, 1)
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return np.asarray(mask & ~inside)
