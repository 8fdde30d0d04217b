"""factorize.complete: pixels of an object that are hidden by a nearer one."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.cameras.image import Image, faded
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.rule import Context, Fraction, Options, rule

from .occlusion import grown


class CompleteOptions(Options):
    """Options of factorize.complete."""

    hidden: Fraction = 0.1
    """A view is completed if at least this fraction of its mask's outline borders on something nearer."""


class CompleteBackend(Protocol):
    """Interface of a backend of factorize.complete."""

    def complete(self, ctx: Context, view: ObjectView, options: Any) -> tuple[np.ndarray, np.ndarray]:
        """Colours (H, W, 3) uint8 and mask (H, W) bool of the whole object, in the crop of `view`."""
        ...


@rule(version=1, packages=("numpy",))
def complete(ctx: Context[CompleteBackend], view: ObjectView, *, options: CompleteOptions | None = None) -> ObjectView:
    """Return the view with colours and mask of the whole object, in the same crop (DEXTERA, section III-A).

    Pixels of the mask keep their colour. Only pixels of `occluder` are added to it, and they stay marked there, so that
    the depth of the nearer object is never used for this one. A view with little occlusion is returned unchanged.
    """
    part = hidden_part(view.mask, view.occluder)
    ctx.metric("hidden outline", 100.0 * part, "%")
    if part < (options or CompleteOptions()).hidden:
        ctx.say(f"{part:.0%} of the outline hidden: visible part only")
        return view
    pixels, whole = ctx.backend.complete(ctx, view, ctx.backend_options)
    ctx.check(
        pixels.shape == view.rgb.pixels.shape and whole.shape == view.mask.shape,
        "the completed view has another size than the crop",
        crop=f"{view.mask.shape[1]} x {view.mask.shape[0]} px",
        completed=f"{whole.shape[1]} x {whole.shape[0]} px",
        hint="use backend `visible`",
    )
    added = whole & ~view.mask
    kept = bool(whole[view.mask].all() and (pixels[view.mask] == view.rgb.pixels[view.mask]).all())
    ctx.check(kept, "the completed view changes visible pixels of the object", hint="use backend `visible`")
    outside = int((added & ~view.occluder).sum())
    ctx.check(
        outside == 0, "the mask grew where nothing hides the object", pixels=outside, hint="use backend `visible`"
    )
    if not added.any():
        ctx.say(f"{part:.0%} of the outline hidden, nothing completed")
        return view
    ctx.say(f"{part:.0%} of the outline hidden, {added.sum() / view.mask.sum():.0%} of the seen area added")
    ctx.preview(np.hstack([faded(view.rgb.pixels, view.mask), faded(pixels, whole)]), "seen and completed")
    colours = np.where(added[..., None], pixels, view.rgb.pixels)
    return view.model_copy(update={"rgb": Image(pixels=colours), "mask": whole})


def hidden_part(mask: np.ndarray, occluder: np.ndarray) -> float:
    """Fraction of the pixels next to a mask (H, W) bool that `occluder` (H, W) bool covers; 0 for an empty mask."""
    around = grown(mask) & ~mask
    return float(occluder[around].mean()) if around.any() else 0.0
