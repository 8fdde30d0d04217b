"""The program that measures fills tells a seam at the picture's border."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Mesh
from tests import factories
from tests.benchmarks.fills import seam


@dataclass
class Made:
    """The two meshes of a background that the seam is measured on."""

    mesh: Mesh
    invented: Mesh


def sheet(grey: int) -> Mesh:
    """A grey square of 4 m at z = 0."""
    corners = np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    pixels = np.full((4, 4, 3), grey, np.uint8)
    return Mesh(vertices=corners, faces=faces, uv=np.full((2, 3, 2), 0.5, np.float32), texture=Image(pixels=pixels))


@pytest.mark.medium
def test_a_seam_is_the_step_of_colour_at_the_pictures_border() -> None:
    camera, pose = factories.camera(320, 240), factories.support(0.45).camera_pose.matrix
    # L* of 128 is 53.6 and of 133 55.5.
    assert seam(cast(Any, Made(sheet(128), sheet(133))), camera, pose) == pytest.approx(1.9, abs=0.1)
    assert seam(cast(Any, Made(sheet(128), sheet(128))), camera, pose) == pytest.approx(0.0, abs=1e-6)
