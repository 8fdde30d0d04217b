"""benchmark.pose_errors: errors of placements of known meshes, modulo the symmetries of their shapes."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.table import Table
from dextera_build.geometry import kinematics, symmetry, transforms
from dextera_build.geometry.raycast import RayScene
from dextera_build.geometry.symmetry import Symmetry
from dextera_build.rule import Context, Options, rule

from . import errors

SAME = 1e-4
"""Largest distance between corners of one mesh in two frames, relative to its size."""
SAMPLES = 1000
"""Number of points with which symmetries are found."""


class PoseErrorsOptions(Options):
    """Options of benchmark.pose_errors."""

    wrong_deg: float = Field(10.0, gt=0.0)
    """Rotation error above which an orientation is a different one, for which no region is evaluated [deg]."""


@rule(version=1, packages=("numpy", "scipy", "open3d"))
def pose_errors(
    ctx: Context,
    world: World,
    assets: Collection[Body],
    placements: Collection[Placement],
    support: Support,
    *,
    options: PoseErrorsOptions | None = None,
) -> Table:
    """Return errors of centroid [mm], rotation [deg] and scale [%] of each placed `reference.perfect_asset`.

    An asset's mesh has the same corners as one object of the world, from which the true similarity follows. Errors are
    in the camera's frame, because the twin's world has another origin.
    """
    options = options or PoseErrorsOptions()
    rows: list[errors.Row] = []
    to_twin = support.camera_pose.matrix @ transforms.invert(world.camera_pose.matrix)
    for label, body in assets.items.items():
        if label in placements.items:
            name, scale, pose = _truth(ctx, world, body, label)
            rows += _judged(name, body, placements.items[label], scale, to_twin @ pose, options)
    missing = len(assets.items) - len(placements.items)
    ctx.say(f"{len(placements.items)} placed, {missing} refused")
    return errors.table(
        "Placements of true meshes in frames and units of their own",
        rows,
        (
            "object: distance of the surface's centroid; angle: least over the rotational symmetries of the mesh; "
            "scale: logarithm of found over true",
            "in region, object and angle: position and rotation jointly (6 numbers), not for round things and for "
            f"rotations that are wrong by more than {options.wrong_deg:g} deg",
        ),
    )


def _truth(ctx: Context, world: World, body: Body, label: str) -> tuple[str, float, np.ndarray]:
    """Name of the object whose mesh the body is, metres per unit, and T_reference_asset (4, 4)."""
    own = body.links["base"].mesh.vertices.astype(np.float64)
    found = [(name, *each) for name, thing in world.objects.items() if (each := _match(own, thing))]
    if not found:
        ctx.fail(
            f"`{label}` has the mesh of no thing of the world", hint="give the assets of `reference.perfect_asset`"
        )
    return found[0]


def _match(own: np.ndarray, thing: Thing) -> tuple[float, np.ndarray] | None:
    """Metres per unit and T_reference_asset (4, 4) if corners (V, 3) are those of the object."""
    its = np.concatenate([part.mesh.vertices for part in thing.parts.values()]).astype(np.float64)
    if len(its) != len(own):
        return None
    scale, pose = _similarity(own, its)
    apart = np.linalg.norm(transforms.apply(pose, scale * own) - its, axis=1).max()
    return (scale, thing.pose.matrix @ pose) if apart < SAME * float(np.ptp(its, axis=0).max()) else None


def _similarity(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and motion (4, 4) with target = motion [scale source, 1], by least squares (Umeyama 1991)."""
    own, its = source.mean(axis=0), target.mean(axis=0)
    left, sizes, right = np.linalg.svd((target - its).T @ (source - own))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = float((sizes * signs).sum() / ((source - own) ** 2).sum())
    turn = left @ np.diag(signs) @ right
    return scale, transforms.rigid(turn, its - scale * turn @ own)


def _judged(
    name: str, body: Body, placed: Placement, scale: float, pose: np.ndarray, options: PoseErrorsOptions
) -> list[errors.Row]:
    alike = _symmetry(body)
    found, centre = placed.pose.matrix, alike.centre
    move = transforms.apply(found, placed.scale * centre[None]) - transforms.apply(pose, scale * centre[None])
    angle = float(np.degrees(alike.angle(pose[:3, :3], found[:3, :3])))
    grown = float(np.log(placed.scale / scale))
    spread = None if placed.scale_sigma is None else np.array([[placed.scale_sigma**2]])
    region = None
    if alike.round_axis is None and angle < options.wrong_deg:
        region = errors.inside(_nearest(found, pose, scale, alike), placed.pose.covariance)
    return [
        (name, "object", "mm", 1000 * float(np.linalg.norm(move)), region),
        (name, "object angle", "deg", angle, region),
        (name, "object scale", "%", 100 * abs(grown), errors.inside(np.array([grown]), spread)),
    ]


def _nearest(found: np.ndarray, pose: np.ndarray, scale: float, alike: Symmetry) -> np.ndarray:
    """Error (6,) relative to the nearest of the true poses that are equivalent by symmetry."""
    centre = scale * alike.centre
    poses = [pose @ transforms.rigid(turn, centre - turn @ centre) for turn in alike.turns()]
    return min((errors.off(found, each) for each in poses), key=lambda error: float(np.linalg.norm(error[3:])))


def _symmetry(body: Body) -> Symmetry:
    vertices, faces = kinematics.posed_surface(body)
    return symmetry.find(vertices, faces, RayScene((vertices, faces)).distances, samples=SAMPLES)
