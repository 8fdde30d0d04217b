"""background.static: the static scene, with all objects and the robot removed from the photograph."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from .behind import Behind


class StaticOptions(Options):
    """Options of background.static."""

    margin_m: NonNegativeFloat = 0.01
    """Extension of the support's collision box beyond its outline [m]."""
    thickness_m: PositiveFloat = 0.05
    """Thickness of the collision box of the support [m]."""


class BackgroundBackend(Protocol):
    """Interface of a backend of background.static."""

    def clean(
        self,
        ctx: Context,
        photograph: Photograph,
        depth: np.ndarray,
        support: Support,
        instances: InstanceMap,
        robot: np.ndarray,
        behind: Behind | None,
        common: StaticOptions,
        options: Any,
    ) -> Background:
        """Remove objects and the robot from photograph and depth, and reconstruct the surface behind them [m, world].

        `depth` is (H, W) float32 [m], 0 where nothing was measured; `robot` (H, W) bool; `behind` what further
        photographs show, or None.
        """
        ...


# A colour between two values of 8 bits may be rounded to either.
@rule(
    version=6,
    tolerance=Tolerance({"": ROUNDING, "image.pixels": 1, "mesh.texture.pixels": 1, "invented.texture.pixels": 1}),
)
def static(
    ctx: Context[BackgroundBackend],
    photograph: Photograph,
    support: Support,
    instances: InstanceMap,
    measured: Measured | None = None,
    robot: LabelImage | None = None,
    further: FurtherPhotographs | None = None,
    *,
    options: StaticOptions | None = None,
) -> Background:
    """Return the cleaned photograph and depth, the room's textured surfaces in the world frame [m], collision boxes.

    Objects are removed, and the robot at the pixels where `robot` is not 0. Everything else is kept. Surfaces without a
    visible pixel are separate, in `invented`. Surfaces are visual only; the boxes collide. The first box is the support
    with its top at z = 0. Without depth, only the support has a measured surface. Where a photograph of `further` shows
    what is behind the objects, its depth and colours are taken; what stands on the support in it is excluded.
    """
    options = options or StaticOptions()
    size = photograph.rgb.pixels.shape[:2]
    labels = instances.labels
    if labels.shape != size:
        ctx.fail("the instances are of another picture", photograph=f"{size}", labels=f"{labels.shape}")
    machine = np.zeros(size, bool) if robot is None else robot.labels != 0
    if machine.shape != size:
        ctx.fail("the robot's pixels are of another picture", photograph=f"{size}", robot=f"{machine.shape}")
    depth = np.zeros(size, np.float32) if measured is None else measured.depth.depth
    others = () if further is None else further.items
    behind = _behind(photograph, depth, support, (labels > 0) | machine, others) if others else None
    made = ctx.backend.clean(ctx, photograph, depth, support, instances, machine, behind, options, ctx.backend_options)
    result = made.model_copy(update={"asset_source": "rgb" if measured is None else "rgbd"})
    top = result.boxes[0].centre[2] + result.boxes[0].half_size[2]
    ctx.check(abs(top) < 1e-9, "the support's box does not end at z = 0", top=f"{top * 1000:.3f} mm")
    ctx.check(len(result.mesh.faces) > 0, "nothing of the background was measured", hint="lower `stride`")
    hidden = (labels > 0) | machine
    untouched = float((result.image.pixels == photograph.rgb.pixels).all(axis=-1).mean())
    ctx.metric("filled", 100.0 * (1.0 - untouched), "%")
    for number, one in enumerate(others, start=1):
        assert behind is not None
        ctx.metric(f"hidden pixels seen by {one.file}", 100.0 * float((behind.source[hidden] == number).mean()), "%")
    invented = 0 if result.invented is None else len(result.invented.faces)
    ctx.metric("faces", len(result.mesh.faces))
    ctx.metric("invented faces", invented)
    ctx.say(
        f"{hidden.mean():.0%} of the photograph taken out, {len(result.mesh.faces):,} faces, {invented:,} invented, "
        f"{len(result.boxes)} collision {'box' if len(result.boxes) == 1 else 'boxes'}"
        + ("" if behind is None else f", {behind.mask[hidden].mean():.0%} of what was hidden seen by others")
    )
    ctx.preview(result.image.pixels, "the photograph without objects")
    return result


def _behind(
    photograph: Photograph, depth: np.ndarray, support: Support, hidden: np.ndarray, others: tuple[Further, ...]
) -> Behind:
    """What further photographs show of the empty scene; needs OpenCV, which one photograph does not need here."""
    from .seen_behind import seen_behind

    return seen_behind(photograph, depth, support, hidden, others)
