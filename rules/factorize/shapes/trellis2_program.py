"""Program of backend `trellis2` of factorize.mesh; runs in the environment of TRELLIS.2."""

from __future__ import annotations

import importlib
import os
from typing import Any

import cutout  # type: ignore[import-not-found]  # in this folder
import dxb_backend  # type: ignore[import-not-found]

_CUBE = [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]]
_RASTERISED = 16_777_216
"""Maximum number of faces that nvdiffrast accepts."""
_loaded: list[Any] = []


def complete(request: Any) -> Any:
    """A GLB of the object in the cut-out picture."""
    options = request.options
    mesh = _pipeline(request).run(cutout.rgba(request), seed=request.seed, pipeline_type=options["resolution"])[0]
    mesh.simplify(_RASTERISED)
    made = importlib.import_module("o_voxel").postprocess.to_glb(
        vertices=mesh.vertices,
        faces=mesh.faces,
        attr_volume=mesh.attrs,
        coords=mesh.coords,
        attr_layout=mesh.layout,
        voxel_size=mesh.voxel_size,
        aabb=_CUBE,
        decimation_target=options["faces"],
        texture_size=options["texture_px"],
        remesh=True,
        remesh_band=1,
        remesh_project=0,
    )
    path = request.file("made.glb")
    made.export(str(path), extension_webp=False)
    return dxb_backend.value("File", file=path)


def _pipeline(request: Any) -> Any:
    if not _loaded:
        os.environ.setdefault("PYTORCH_CUDA_ALLOC_CONF", "expandable_segments:True")
        kind = importlib.import_module("trellis2.pipelines").Trellis2ImageTo3DPipeline
        pipeline = kind.from_pretrained(str(request.weights["trellis2"]))
        pipeline.cuda()
        _loaded.append(pipeline)
    return _loaded[0]


dxb_backend.serve(complete=complete)
