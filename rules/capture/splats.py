"""capture.splats: import 3D Gaussians from the file of a trainer."""

from __future__ import annotations

from typing import Literal

from dextera_build.artifacts import splats_usd
from dextera_build.artifacts.base import File
from dextera_build.artifacts.splats import Splats
from dextera_build.gaussians import splatting
from dextera_build.rule import Context, Options, rule


class SplatsOptions(Options):
    """Options of capture.splats."""

    form: Literal["ply", "usda", "usdc", "usd", "usdz"] = "ply"
    """`ply`: the columns of Kerbl et al. 2023; USD: one `ParticleField3DGaussianSplat`."""
    frame: str = ""
    """Frame of the coordinates; "": as stated in the file."""


@rule(version=1, packages=("numpy", "usd-core"))
def splats(ctx: Context, file: File, *, options: SplatsOptions) -> Splats:
    """Return the Gaussians of a file, in the frame and unit of a PLY; a USD is converted to z up and metres."""
    path = ctx.scratch / "splats" / f"splats.{options.form}"  # without a folder: it names no other file
    file.place(path)
    load = Splats.load if options.form == "ply" else splats_usd.load
    made = load(path, frame=options.frame or None)
    ctx.metric("Gaussians", len(made.means))
    ctx.preview(splatting.preview(made.gaussians), "the Gaussians")
    ctx.say(", ".join(made.facts()))
    return made
