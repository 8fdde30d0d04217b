"""Program of backend `hy_pano` of background.panorama; runs in the environment of HY-Pano 2.0.

The repository's modules in `hyworld2/panogen` are on the path of the environment.
"""

from __future__ import annotations

import importlib
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_HEIGHT, _BLEND = 960, 32
"""Rows of the panorama, and columns that the pipeline blends and crops, as set by its authors."""
_loaded: list[Any] = []


def panorama(request: Any) -> Any:
    """The panorama of the photograph, twice as wide as high."""
    options = request.options
    made = _pipeline(request)(
        str(request.inputs["image"].path),
        prompt=options["prompt"],
        seed=request.seed,
        height=_HEIGHT,
        width=2 * _HEIGHT + _BLEND,
        num_inference_steps=options["steps"],
        true_cfg_scale=options["guidance"],
        blend_width=_BLEND,
    )
    path = request.file("panorama.png")
    made.save(str(path))
    return dxb_backend.value("Image", file=path)


def _pipeline(request: Any) -> Any:
    if not _loaded:
        kind = importlib.import_module("pipeline_with_qwen_image").HunyuanPanoPipeline
        pipeline = kind.from_pretrained(
            str(request.weights["qwen_image_edit"]),
            lora_path=str(request.weights["hy_pano_2"]),
            lora_subfolder="HY-Pano-2.0",
        )
        _loaded.append(pipeline)
    return _loaded[0]


dxb_backend.serve(panorama=panorama)
