"""background.paths: plan paths of virtual cameras around the position of the photograph."""

from __future__ import annotations

from typing import Any, Protocol

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.geometry.plot import COLOURS, Line, plot
from dextera_build.rule import ROUNDING, Context, Tolerance, rule


class PathsBackend(Protocol):
    """Interface of a backend of background.paths."""

    def plan(
        self, ctx: Context, panorama: Panorama, background: Background, support: Support, options: Any
    ) -> Collection[Trajectory]:
        """Paths T_world_camera through free space; the stamps order the cameras of a path."""
        ...


@rule(version=1, packages=("numpy",), tolerance=Tolerance({"": ROUNDING}))
def paths(
    ctx: Context[PathsBackend], panorama: Panorama, background: Background, support: Support
) -> Collection[Trajectory]:
    """Return paths of virtual cameras in the world frame [m], by name, above the support and clear of the surface."""
    made: Collection[Trajectory] = ctx.backend.plan(ctx, panorama, background, support, ctx.backend_options)
    ctx.check(len(made.items) > 0, "no path is free", hint="lower the clearance or the angles of the backend")
    for label, path in made.items.items():
        ctx.check(
            (path.parent, path.child) == ("world", "camera"),
            f"`{label}` is a path of `{path.child}` in `{path.parent}`",
        )
        lowest = float(path.poses[:, 2].min())
        ctx.check(lowest > 0.0, f"`{label}` leads below the support", lowest=f"{lowest * 1000:.0f} mm")
    count = sum(len(path.stamps) for path in made.items.values())
    length = sum(path.length_m() for path in made.items.values())
    ctx.metric("cameras", count)
    ctx.say(f"{len(made.items)} paths, {count} cameras, {length:.2f} m")
    lines = [Line(path.poses[:, :2], dots=True) for path in made.items.values()]
    ctx.preview(plot([*lines, Line(support.polygon, COLOURS[1])], "x [m]", "y [m]", equal=True), "cameras from above")
    return made
