"""A finished body as the shape that backends of factorize.mesh return."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose

from .hypotheses import Finished
from .paint import paint
from .scoring import Judgement


def lifted(body: Finished, base: float) -> Finished:
    """Move a body with z = 0 on the supporting surface to the world frame of the support."""
    pose = body.pose.copy()
    pose[2, 3] += base
    return replace(body, pose=pose)


def shaped(
    name: str,
    body: Finished,
    judged: Judgement,
    scores: dict[str, float],
    seen: Seen,
    texture_px: int,
    symmetry: np.ndarray | None = None,
    *,
    revolved: bool = False,
) -> Shape:
    """The textured shape of a body in the world frame.

    Args:
        name: The best hypothesis.
        body: The body.
        judged: Its scores for the view.
        scores: Hypothesis -> score.
        seen: The view, whose colours are painted on it.
        texture_px: See `paint`.
        symmetry: See `paint`.
        revolved: See `paint`.
    """
    painted = paint(body.solid, body.pose, seen, texture_px, symmetry, revolved=revolved)
    mesh = Mesh(
        vertices=body.solid.vertices.astype(np.float32),
        faces=body.solid.faces.astype(np.int32),
        uv=painted.uv,
        texture=Image(pixels=painted.pixels),
    )
    return Shape(
        mesh=mesh,
        walls=tuple(Hull(vertices=corners.astype(np.float32)) for corners in body.walls),
        pose=Pose(parent="world", child="object", matrix=body.pose),
        hypothesis=name,
        hollow=body.hollow,
        residual_m=judged.residual_m if np.isfinite(judged.residual_m) else None,
        mask_iou=judged.mask_iou,
        unseen_fraction=1.0 - sum(painted.seen),
        further_seen=painted.seen[1:],
        scores=scores,
    )
