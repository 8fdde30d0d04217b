"""What is taken out of the photograph."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.artifacts.view import InstanceMap
from dextera_build.geometry import regions


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
