"""Open3D loads without its viewers and imports them on request."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

HEAVY = ("dash", "plotly", "IPython")


def run(code: str) -> str:
    """What a new process prints."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=300
    ).stdout


@pytest.mark.medium
def test_rays_are_cast_without_the_viewers() -> None:
    code = """if True:
        import sys
        import numpy as np
        from dextera_build.geometry import open3d_core, raycast
        from dextera_build.geometry.solids import box
        cube = box((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
        rays = np.array([[0.0, 0.0, 5.0, 0.0, 0.0, -1.0]])
        print(round(float(raycast.RayScene((cube.vertices, cube.faces)).cast(rays).distance[0]), 4), end=" ")
    """
    assert run(code + f"    print([name for name in {HEAVY} if name in sys.modules])") == "4.5 []\n"


@pytest.mark.slow
def test_the_viewers_are_loaded_when_somebody_asks_for_them() -> None:
    code = """if True:
        from dextera_build.geometry import open3d_core
        library = open3d_core.loaded()
        print(hasattr(library, "nonsense"), library.visualization.draw_plotly.__module__)
        import open3d
        print(open3d is library is open3d_core.loaded())
    """
    assert run(code).splitlines() == ["False open3d.visualization.draw_plotly", "True"]
