"""Links and joints from the mesh alone, by Particulate in its own environment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.objects.view import Seen, State
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from .parts import Parts
from .picture import draw
from .urdf_links import read

if TYPE_CHECKING:
    from .articulate import ArticulateOptions

BACKEND = Backend(
    summary="Particulate, from the mesh alone",
    packages=("manifold3d", "pillow", "trimesh"),
    extra="twin",
    command=("{python}", "particulate_program.py"),
    environment="venv:.envs/particulate",
    lock="envs/particulate.lock",
    gpu_gb=16.0,
    timeout_s=1800.0,
    weights=("particulate", "partfield"),
    licence="none stated (Particulate), NVIDIA License, not for commercial use (PartField)",
)


class ParticulateOptions(Options):
    """Options of backend `particulate` of factorize.articulate."""

    points: int = Field(102_400, ge=2_000, le=1_000_000)
    """Number of surface points that the network samples; at least twice the number of faces."""
    least_confidence: float = Field(0.0, ge=0.0, le=1.0)
    """Parts with a lower confidence are merged."""
    whole_components: bool = False
    """Assign each connected component of the mesh to one part. A generated mesh is one component."""


def parts(
    ctx: Context,
    shape: Shape,
    measured: Measurements[Seen],
    again: State | None,
    common: ArticulateOptions,
    options: ParticulateOptions,
) -> Parts | None:
    """The parts that Particulate (Li et al., 2025) finds, with all joints at 0 as in the photograph.

    Masses of its URDF are ignored, because `factorize.physics` estimates them. No measurement is used.
    """
    if common.hinge is not None:
        ctx.fail("particulate takes no declared `hinge`", hint="leave `hinge` out, or use backend `crease`")
    made = ctx.outside("articulate", Folder, mesh=shape.mesh)
    folder = Path(ctx.scratch, "urdf")
    for name, data in made.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    try:
        links, joints = read(folder / "model.urdf")
    except (OSError, ValueError) as error:
        ctx.fail(f"the URDF of particulate cannot be read: {error}", hint="use backend `crease`")
    if not joints:
        return None
    # infer.py moves the middle of the mesh to the origin and divides by its longest side.
    low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    middle, longest = (low.astype(np.float64) + high) / 2.0, float((high - low).max())
    return Parts(
        {name: Link(mesh=_placed(link.mesh, middle, longest)) for name, link in links.items()},
        tuple(_joint(joint, middle, longest) for joint in joints),
    )


def picture(ctx: Context, body: Body, seen: Seen, options: ParticulateOptions) -> np.ndarray:
    """Draw the joints on the crop, (H, W, 3) uint8."""
    return draw(body, seen)


def _placed(mesh: Mesh, middle: np.ndarray, longest: float) -> Mesh:
    return mesh.model_copy(update={"vertices": (mesh.vertices * longest + middle).astype(np.float32)})


def _joint(joint: Joint, middle: np.ndarray, longest: float) -> Joint:
    unit = longest if joint.type == "prismatic" else 1.0
    x, y, z = (np.array(joint.origin) * longest + middle).tolist()
    return joint.model_copy(update={"origin": (x, y, z), "lower": joint.lower * unit, "upper": joint.upper * unit})
