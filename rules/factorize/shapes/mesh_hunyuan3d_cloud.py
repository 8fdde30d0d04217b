"""Textured meshes from the photograph alone, by Tencent Cloud's Hunyuan3D; answers are recorded."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from .generated import shape_of
from .hunyuan3d_job import HunyuanJob

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="Hunyuan3D of Tencent Cloud, from the photograph alone; costs credits, see `docs/calls.md`",
    profiles=("cloud",),
    packages=("httpx", "manifold3d", "open3d", "pillow", "tencentcloud-sdk-python-ai3d", "trimesh"),
    extra="cloud",
    licence="that of the service",
)
SERVICE = "hunyuan3d"
_MARGIN = 0.1
"""White border around the object, as a fraction of its longer side."""
_SIDES = (256, 1024)
"""Minimum and maximum side of the uploaded picture [px]; the service takes 128 to 5000."""


class Hunyuan3dCloudOptions(Options):
    """Options of backend `hunyuan3d_cloud` of factorize.mesh."""

    model: Literal["3.0", "3.1"] = "3.1"
    """Version of Hunyuan3D."""
    kind: Literal["Normal", "Geometry"] = "Normal"
    """With or without a texture, the API's `GenerateType`."""
    faces: Annotated[int, Field(ge=3000, le=1_500_000)] | None = 40_000
    """Number of faces; None leaves it to the service, which makes about 500,000 for fewer credits."""
    pbr: bool = False
    """Also generate metalness and roughness maps, for more credits; only the colours are used."""


def complete(
    ctx: Context,
    view: ObjectView,
    measured: Measurements[Seen],
    common: MeshOptions,
    options: Hunyuan3dCloudOptions,
) -> Shape:
    """Return the mesh that the service generates from the object on a white background. No measurement is used."""
    if not view.mask.any():
        ctx.fail("the mask is empty", hint="drop the element, or look at its mask")
    pixels = cut_out(view)
    faces = {} if options.faces is None else {"FaceCount": options.faces}
    parameters = {"Model": options.model, "GenerateType": options.kind, "EnablePBR": options.pbr, **faces}
    # Pixels, not a file, so that another version of the encoder does not change the request.
    request = {"model": options.model, "parameters": parameters, "pixels": pixels.tobytes(), "shape": [*pixels.shape]}
    body = ctx.job(
        SERVICE,
        request,
        HunyuanJob(parameters, _png(pixels), ctx.secret),
        valid=_refuse_other_files,
        data=("photograph",),
        poll_s=5.0,
        limit_s=1800.0,
    )
    return shape_of(ctx, body, ".glb", view, f"hunyuan3d {options.model}", common.texture_px)


def cut_out(view: ObjectView) -> np.ndarray:
    """The object's pixels centred on a white square, (S, S, 3) uint8 sRGB."""
    from PIL import Image

    rows, columns = np.flatnonzero(view.mask.any(axis=1)), np.flatnonzero(view.mask.any(axis=0))
    white = np.where(view.mask[..., None], view.rgb.pixels, np.uint8(255))
    part = white[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    side = round(max(part.shape[:2]) * (1.0 + 2.0 * _MARGIN))
    square = np.full((side, side, 3), 255, np.uint8)
    top, left = (side - part.shape[0]) // 2, (side - part.shape[1]) // 2
    square[top : top + part.shape[0], left : left + part.shape[1]] = part
    wanted = int(np.clip(side, *_SIDES))
    if wanted == side:
        return square
    return np.asarray(Image.fromarray(square).resize((wanted, wanted), Image.Resampling.LANCZOS))


def _png(pixels: np.ndarray) -> bytes:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG")
    return data.getvalue()


def _refuse_other_files(body: bytes) -> None:
    """Raise `ValueError` unless the body is a complete binary glTF 2.0 (section 4.4)."""
    if body[:4] != b"glTF" or int.from_bytes(body[4:8], "little") != 2:
        raise ValueError("the file is not a binary glTF 2.0")
    if int.from_bytes(body[8:12], "little") != len(body):
        raise ValueError(
            f"the file has {len(body):,} bytes, but its header states {int.from_bytes(body[8:12], 'little'):,}"
        )
