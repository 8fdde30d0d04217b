"""background.panorama: extend the cleaned photograph to all directions around its camera."""

from __future__ import annotations

from typing import Any, Protocol

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.rule import Context, rule


class PanoramaBackend(Protocol):
    """Interface of a backend of background.panorama."""

    def widen(self, ctx: Context, background: Background, camera: Camera, support: Support, options: Any) -> Panorama:
        """The panorama around the camera's position, in the world frame, with `seen` if known."""
        ...


@rule(version=1, packages=("numpy",))
def panorama(ctx: Context[PanoramaBackend], background: Background, camera: Camera, support: Support) -> Panorama:
    """Return a panorama around the photograph's camera, with the pixels that the photograph shows.

    The other pixels are filled in or generated.
    """
    size = background.image.pixels.shape[:2]
    if size != (camera.height, camera.width):
        ctx.fail("the camera is that of another picture", picture=f"{size}", camera=f"{camera.height, camera.width}")
    made: Panorama = ctx.backend.widen(ctx, background, camera, support, ctx.backend_options)
    height, width = made.image.pixels.shape[:2]
    ctx.check(width == 2 * height, "the panorama is not twice as wide as high", size=f"{width} x {height} px")
    ctx.check(made.pose.parent == "world", "the panorama is not placed in the world", frame=made.pose.parent)
    ahead = support.camera_pose.matrix[:3, 3] - made.pose.matrix[:3, 3]
    ctx.check(abs(ahead).max() < 1e-9, "the panorama is not around the place of the camera")
    part = "seen pixels unknown" if made.seen is None else f"{made.seen.mean():.0%} seen"
    if made.seen is not None:
        ctx.metric("seen", 100.0 * float(made.seen.mean()), "%")
    ctx.say(f"{width} x {height} px, {part}")
    ctx.preview(made.image.pixels, f"all directions around the camera; {part}")
    return made
