"""align.canonical: canonical up and front axes of a body."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.objects.canonical import CanonicalFrame, Open, SymmetryAxis
from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import canonical as geometry
from dextera_build.geometry import kinematics, symmetry, thumbnail, transforms
from dextera_build.geometry.symmetry import Symmetry
from dextera_build.rule import Context, rule

from .bodies import Surface
from .chosen import Chosen


class CanonicalBackend(Protocol):
    """Interface of a backend of align.canonical."""

    def choose(self, ctx: Context, surface: Surface, seen_up: np.ndarray | None, options: Any) -> Chosen:
        """Choose up and front among the own axes of a surface; `seen_up` (3,) is up in the photograph."""
        ...


@rule(version=1, packages=("numpy", "open3d", "scipy"), cpus=1)
def canonical(ctx: Context[CanonicalBackend], body: Body, placement: Placement | None = None) -> CanonicalFrame:
    """Return the canonical frame of a body: one of the 24 rotations that map its own axes to z (up) and x (front).

    Axes that the backend cannot determine are named in `undecided`. A symmetry of the shape is given by axis and order:
    of fronts that it maps to each other none is preferred, unless their colours differ.

    `placement` is the pose of the body in the photograph. `artifacts.similar` applies the frame to links, joints,
    masses, collision pieces and Gaussians.
    """
    vertices, faces = kinematics.posed_surface(body)
    surface = Surface(body, vertices, faces)
    seen_up = None if placement is None else np.array(placement.pose.matrix[2, :3])
    found = symmetry.find(vertices, faces, surface.distances)
    chosen = ctx.backend.choose(ctx, surface, seen_up, ctx.backend_options)
    undecided = set(chosen.undecided)
    if not chosen.by_colour and _same(found, chosen):
        undecided.add("front")
    turn = geometry.rotation(chosen.up, chosen.front)
    moved = vertices @ turn.T
    low, high = moved.min(axis=0), moved.max(axis=0)
    base = np.array([*((low + high) / 2.0)[:2], low[2]])
    order: tuple[Open, ...] = ("up", "front")
    frame = CanonicalFrame(
        pose=Pose(parent="canonical", child="object", matrix=transforms.rigid(turn, -base)),
        undecided=tuple(name for name in order if name in undecided),
        symmetry=tuple(_axis(axis) for axis in found.axes),
        up_lead=chosen.up_lead,
        front_lead=chosen.front_lead,
        method=chosen.method,
    )
    corners = transforms.apply(frame.pose.matrix, vertices)[faces]
    ctx.preview(thumbnail.thumbnail([(corners, surface.paint)]), "the body in its canonical frame, x to the right")
    left = f", undecided: {', '.join(frame.undecided)}" if frame.undecided else ""
    ctx.say(f"{chosen.method}, symmetry: {found}{left}")
    return frame


def _same(found: Symmetry, chosen: Chosen) -> bool:
    """Whether a symmetry maps the chosen front to another horizontal direction."""
    if found.is_ball:
        return True
    if found.round_axis is not None and abs(float(found.round_axis @ chosen.up)) > 0.99:
        return True
    stays = [turn for turn in found.turns() if float((turn @ chosen.up) @ chosen.up) > 0.99]
    return any(float((turn @ chosen.front) @ chosen.front) < 0.9 for turn in stays)


def _axis(axis: symmetry.Axis) -> SymmetryAxis:
    x, y, z = (float(part) for part in axis.direction)
    return SymmetryAxis(axis=(x, y, z), order=axis.order)
