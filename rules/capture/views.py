"""capture.views: read pictures with known cameras and poses."""

from __future__ import annotations

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.views import Views
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule


class ViewsOptions(Options):
    """Options of capture.views."""

    frame: str = ""
    """Frame of the poses; empty: as stated in the files, otherwise `world`."""


@rule(version=1, packages=("numpy", "pillow"))
def views(ctx: Context, folder: Folder, *, options: ViewsOptions) -> Views:
    """Return the pictures of a COLMAP text model or a `transforms.json`, with poses in OpenCV axes."""
    found = Views.parse({path: File(data=data) for path, data in folder.files.items()})
    if not found.names:
        ctx.fail("no picture has a pose", here=listing(folder.files), hint="reconstruct the scene first")
    for number, name in enumerate(found.names):
        found.pixels(name)  # of the size that its camera states
        ctx.progress(number + 1, len(found.names), "pictures")
    if options.frame:
        points = found.points and found.points.model_copy(update={"frame": options.frame})
        found = found.model_copy(update={"frame": options.frame, "points": points})
    ctx.say(", ".join(found.facts()))
    return found
