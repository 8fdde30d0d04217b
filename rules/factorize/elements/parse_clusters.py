"""Elements from geometry: raised surfaces, split at creases and depth steps, named by colour and shape."""

from __future__ import annotations

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Elements
from dextera_build.geometry.upright import turned
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace, turned_elements
from ..regions.proposals import colour_lab, scenery
from . import naming

BACKEND = Backend(
    summary="surface patches above the support, named by colour, and by outline and size or shape",
    profiles=("cpu",),
    packages=("numpy", "scipy", "opencv-python-headless"),
    extra="twin",
)


def propose(ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: Options) -> Elements:
    """Every object above the support with its box [px], largest first."""
    workspace = measured.needed()
    level, turns = workspace.upright(), workspace.turns
    seen = scenery(level)
    found = naming.elements(seen.objects, seen.relief, colour_lab(level.pixels), level.world_from_camera[:3, 3])
    size = (level.camera.width, level.camera.height)
    return Elements(elements=turned_elements(found, size, -turns), regions=turned(seen.labels, -turns))
