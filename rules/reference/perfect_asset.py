"""reference.perfect_asset: an object of a reference world as an asset of a perfect image-to-3D model."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeInt

from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.artifacts.scenes.world import Thing, World
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import metrics, raycast, registration, transforms
from dextera_build.rule import Context, Fraction, Options, rule

TURNS = 5000
"""Rotations from which the frame is drawn."""
SHIFT_M = 0.1
"""Standard deviation of the frame's origin along each axis [m]."""


class PerfectAssetOptions(Options):
    """Options of reference.perfect_asset."""

    least_iou: Fraction = 0.5
    """Mask IoU with an object above which the mask shows this object."""
    seed: NonNegativeInt = 0
    """Seed of the frame and the unit."""


@rule(version=1, packages=("numpy", "scipy", "open3d"))
def perfect_asset(ctx: Context, world: World, view: ObjectView, *, options: PerfectAssetOptions | None = None) -> Body:
    """Return the true mesh of the object in the mask, in a random frame and a unit of 0.1 to 10 metres.

    This is a generator with perfect shapes, so that `align.object` must find pose and scale alone, without any hint.
    """
    options = options or PerfectAssetOptions()
    name, iou = _shown(world, view)
    ctx.check(iou >= options.least_iou, f"the mask shows no single thing: `{name}` fits best, with IoU {iou:.2f}")
    draw = np.random.default_rng([options.seed, int(view.mask.sum()), *view.mask.shape])
    turn = registration.spread_rotations(TURNS)[int(draw.integers(TURNS))]
    scale = float(10.0 ** draw.uniform(-1.0, 1.0))
    shift = draw.normal(0.0, SHIFT_M, 3)
    ctx.say(f"a frame and a unit of its own, mask IoU {iou:.2f}")
    return Body(links={"base": Link(mesh=_asset(world.objects[name], turn, shift, scale))})


def _shown(world: World, view: ObjectView) -> tuple[str, float]:
    """The object whose visible pixels in the crop agree best with the mask, and their IoU."""
    surfaces, owners = [], []
    for number, thing in enumerate(world.objects.values()):
        surface = thing.surface
        surfaces.append(
            raycast.Surface(transforms.apply(thing.pose.matrix, surface.vertices.astype(np.float64)), surface.faces)
        )
        owners.append(number)
    camera = view.camera
    seen = raycast.render(surfaces, camera.matrix(), world.camera_pose.matrix, camera.height, camera.width)
    found = [metrics.mask_iou(seen.index == number, view.mask) for number in owners]
    best = int(np.argmax(found))
    return list(world.objects)[best], found[best]


def _asset(thing: Thing, turn: np.ndarray, shift: np.ndarray, scale: float) -> Mesh:
    """All parts as one mesh, x_asset = turn (x_thing + shift) / scale; several parts get the colour of the first."""
    parts = [part.mesh for part in thing.parts.values()]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in parts)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(parts, starts[:-1], strict=True)])
    vertices = np.concatenate([(mesh.vertices.astype(np.float64) + shift) @ turn.T / scale for mesh in parts])
    fields = {"vertices": vertices.astype(np.float32), "faces": faces.astype(np.int32)}
    return parts[0].model_copy(update=fields) if len(parts) == 1 else Mesh(**fields, colour=parts[0].colour)
