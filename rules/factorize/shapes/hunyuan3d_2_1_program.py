"""Program of backend `hunyuan3d_2_1` of factorize.mesh; runs in the environment of Hunyuan3D 2.1.

The repository's modules `hy3dshape` and `hy3dpaint` are on the path of the environment.
"""

from __future__ import annotations

import importlib
import tempfile
from pathlib import Path
from typing import Any

import cutout  # type: ignore[import-not-found]  # in this folder
import dxb_backend  # type: ignore[import-not-found]

_loaded: dict[str, Any] = {}


def complete(request: Any) -> Any:
    """A GLB of the object in the cut-out picture."""
    torch = importlib.import_module("torch")
    picture, options = cutout.rgba(request), request.options
    seeded = torch.Generator(device=request.device).manual_seed(request.seed)
    request.progress(0, 2, "shape")
    mesh = _shape(request)(image=picture, num_inference_steps=options["steps"], generator=seeded)[0]
    request.progress(1, 2, "texture")
    made = request.file("made.glb")
    with tempfile.TemporaryDirectory() as folder:  # the painter writes further files next to the mesh
        bare, painted = Path(folder, "bare.glb"), Path(folder, "painted.obj")
        mesh.export(str(bare))
        _paint(request)(mesh_path=str(bare), image_path=picture, output_mesh_path=str(painted), save_glb=False)
        importlib.import_module("trimesh").load(str(painted), force="mesh").export(str(made))
    return dxb_backend.value("File", file=made)


def _shape(request: Any) -> Any:
    if "shape" not in _loaded:
        kind = importlib.import_module("hy3dshape.pipelines").Hunyuan3DDiTFlowMatchingPipeline
        _loaded["shape"] = kind.from_pretrained(str(request.weights["hunyuan3d_2_1"]), device=request.device)
    return _loaded["shape"]


def _paint(request: Any) -> Any:
    views, side = request.options["views"], request.options["view_px"]
    name = f"paint {views} {side}"
    if name not in _loaded:
        module = importlib.import_module("textureGenPipeline")
        root = Path(str(module.__file__)).parent
        config = module.Hunyuan3DPaintConfig(views, side)
        config.multiview_cfg_path = str(root / "cfgs" / "hunyuan-paint-pbr.yaml")
        config.custom_pipeline = str(root / "hunyuanpaintpbr")
        config.realesrgan_ckpt_path = str(root / "ckpt" / "RealESRGAN_x4plus.pth")
        config.dino_ckpt_path = str(request.weights["dinov2_giant"])
        # The painter would download its weights from the hub; local ones are used.
        weights = str(request.weights["hunyuan3d_2_1"])
        hub: Any = importlib.import_module("huggingface_hub")
        hub.snapshot_download = lambda *given, **more: weights
        _loaded[name] = module.Hunyuan3DPaintPipeline(config)
    return _loaded[name]


dxb_backend.serve(complete=complete)
