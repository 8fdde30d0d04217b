"""Program of backend `sam3d_objects` of factorize.mesh; runs in the environment of SAM 3D Objects.

The repository's `notebook/inference.py` is on the path of the environment, and torch.hub's folder holds DINOv2.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import Any

import cutout  # type: ignore[import-not-found]  # in this folder
import dxb_backend  # type: ignore[import-not-found]

_loaded: list[Any] = []


def complete(request: Any) -> Any:
    """A PLY of the object in the masked picture, z up, with vertex colours."""
    import numpy as np

    pixels = np.asarray(cutout.rgba(request))
    made = _inference(request)(pixels[..., :3], pixels[..., 3] > 0, seed=request.seed)["glb"]
    if made is None:
        raise dxb_backend.Refused("the model made no mesh", "give another seed or another mask")
    open3d = importlib.import_module("open3d")
    # The mesh of the pipeline has y up, as a GLB; its colours are sRGB, as those of a PLY.
    places = np.asarray(made.vertices, np.float64) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(places),
        open3d.utility.Vector3iVector(np.asarray(made.faces, np.int32)),
    )
    colours = np.asarray(made.visual.vertex_colors)[:, :3] / 255.0
    mesh.vertex_colors = open3d.utility.Vector3dVector(colours)
    if len(mesh.triangles) > request.options["faces"]:
        mesh = mesh.simplify_quadric_decimation(request.options["faces"])
    path = request.file("made.ply")
    open3d.io.write_triangle_mesh(str(path), mesh)
    return dxb_backend.value("File", file=path)


def _inference(request: Any) -> Any:
    if not _loaded:
        # `inference.py` reads this variable of conda.
        os.environ.setdefault("CONDA_PREFIX", os.environ.get("CUDA_HOME", sys.prefix))
        hub: Any = importlib.import_module("huggingface_hub")
        points = str(Path(str(request.weights["moge_vitl"]), "model.pt"))
        hub.hf_hub_download = lambda *given, **more: points  # MoGe asks the hub for its weights
        importlib.import_module("torch").hub.download_url_to_file = _no_download
        config = Path(str(request.weights["sam3d_objects"]), "checkpoints", "pipeline.yaml")
        _loaded.append(importlib.import_module("inference").Inference(str(config), compile=False))
    return _loaded[0]


def _no_download(url: str, *given: Any, **more: Any) -> None:
    hint = "run `torch.hub.load` of DINOv2 once in the environment, see docs/models.md"
    raise dxb_backend.Refused(f"{url} is not in the folder of torch.hub, and a build downloads nothing", hint)


dxb_backend.serve(complete=complete)
