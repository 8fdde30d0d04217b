"""benchmark.dimensions: size of the object nearest to the camera compared with ruler measurements."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import boxes, kinematics, transforms
from dextera_build.rule import Context, Options, rule


class DimensionsOptions(Options):
    """Options of benchmark.dimensions: the known true sizes."""

    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] | None = None
    """True edge lengths in any order [m]."""
    height_m: PositiveFloat | None = None
    """True height as standing [m]."""
    hollow: bool | None = None
    """Whether the object is open at the top."""


@rule(version=1, packages=("numpy", "scipy"))
def dimensions(ctx: Context, assets: Collection[Asset], support: Support, *, options: DimensionsOptions) -> Table:
    """Return one row per known true size of the main object, the one nearest to the camera.

    Sizes are the edges of the smallest upright box around the placed surface [m], sorted if the truth is unordered.
    """
    ctx.check(
        support.scale != "unknown",
        "the scale of this twin is unknown, so its sizes cannot be compared with a ruler",
        hint="lay a marker on the support, or measure depth",
    )
    ctx.check(bool(assets.items), "no object was found", hint="look at the masks: `dxb report`")
    name = min(assets.items, key=lambda label: _distance(assets.items[label], support))
    asset = assets.items[name]
    size, _ = boxes.upright_box(_surface(asset))
    rows: list[tuple[Cell, ...]] = []
    if options.size_m is not None:
        pairs = zip(sorted(options.size_m), sorted(size.tolist()), strict=True)
        rows += [(name, f"edge {number}", *_row(true, seen)) for number, (true, seen) in enumerate(pairs, 1)]
    if options.height_m is not None:
        rows.append((name, "height", *_row(options.height_m, float(size[2]))))
    meshes = [link.mesh for link in asset.body.links.values()]
    rows.append((name, "closed", 1.0, float(all(mesh.is_closed for mesh in meshes)), None))
    if options.hollow is not None:
        rows.append((name, "hollow", float(options.hollow), float(asset.body.hollow), None))
    errors = [abs(row[4]) for row in rows if isinstance(row[4], float)]
    ctx.say(f"{name}, {' x '.join(f'{1000 * edge:.0f}' for edge in size)} mm" + _worst(errors))
    return Table(
        title="Dimensions of the main object",
        columns=(
            Column(name="object"),
            Column(name="quantity"),
            Column(name="true", unit="m", digits=4),
            Column(name="twin", unit="m", digits=4),
            Column(name="error", unit="mm", digits=1, better="lower"),
        ),
        rows=tuple(rows),
        notes=("Main object: nearest to the camera.", "Edges of the least upright box around the placed surface."),
    )


def _row(true: float, seen: float) -> tuple[float, float, float]:
    return true, seen, 1000.0 * (seen - true)


def _worst(errors: list[float]) -> str:
    return f", off by at most {max(errors):.1f} mm" if errors else ""


def _surface(asset: Asset) -> np.ndarray:
    """Vertices of every link at the photograph's joint positions, (N, 3) in the world frame [m]."""
    poses = kinematics.link_poses(asset.body, {joint.name: joint.position for joint in asset.body.joints})
    parts = [transforms.apply(poses[name], link.mesh.vertices) for name, link in asset.body.links.items()]
    return transforms.apply(asset.pose.matrix, np.concatenate(parts))


def _distance(asset: Asset, support: Support) -> float:
    return float(np.linalg.norm(_surface(asset).mean(axis=0) - support.camera_pose.matrix[:3, 3]))
