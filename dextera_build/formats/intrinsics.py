"""Camera parameters common to all file formats, for any lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Model = Literal["pinhole", "brown_conrady", "kannala_brandt", "equirectangular"]


@dataclass(frozen=True)
class Intrinsics:
    """A camera in the terms of file formats; integer pixel centres, as in OpenCV and ROS.

    Args:
        model: Kind of lens.
        width: Image width [px].
        height: Image height [px].
        focal: fx and fy [px]; zeros for `equirectangular`, which has none.
        centre: Principal point cx and cy [px].
        coefficients: None for `pinhole` and `equirectangular`; 8 for `brown_conrady`, k1 k2 p1 p2 k3 k4 k5 k6; 4 for
            `kannala_brandt`, k1 to k4.
    """

    model: Model
    width: int
    height: int
    focal: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    coefficients: tuple[float, ...] = ()
