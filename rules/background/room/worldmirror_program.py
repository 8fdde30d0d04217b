"""Program of backend `worldmirror` of background.compose; runs in the environment of WorldMirror 2.0.

The repository's package `hyworld2` is on the path of the environment.
"""

from __future__ import annotations

import importlib
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_loaded: dict[bool, Any] = {}


def compose(request: Any) -> Any:
    """The folder that the pipeline writes for the pictures, without its own pictures of depth."""
    import numpy as np

    options, inputs = request.options, request.inputs
    poses, intrinsics = (np.load(inputs[name].path, allow_pickle=False) for name in ("poses", "intrinsics"))
    with tempfile.TemporaryDirectory() as scratch:
        pictures, prior, out = Path(scratch, "pictures"), Path(scratch, "cameras.json"), Path(scratch, "out")
        pictures.mkdir()
        # The pipeline sorts the names, and looks up the camera of a picture by the name without its suffix.
        stems = [f"{number:04d}" for number in range(len(poses))]
        for stem, picture in zip(stems, inputs["pictures"], strict=True):
            shutil.copyfile(str(picture.path), str(pictures / f"{stem}.png"))
        prior.write_text(json.dumps(_cameras(stems, poses, intrinsics)))
        written = _pipeline(request)(
            str(pictures),
            strict_output_path=str(out),
            target_size=options["longest_px"],
            prior_cam_path=str(prior),
            save_normal=False,
            apply_sky_mask=False,  # it would download a network, and a room contains no sky
            log_time=False,
        )
        if written is None:
            raise RuntimeError("the pipeline skipped the pictures; see its output")
        folder = request.file("made")
        shutil.copytree(str(out), str(folder), ignore=shutil.ignore_patterns("*.png"))
    return dxb_backend.value("Folder", file=folder)


def _cameras(stems: Any, poses: Any, intrinsics: Any) -> Any:
    def rows(matrices: Any) -> Any:
        return [{"camera_id": stem, "matrix": matrix.tolist()} for stem, matrix in zip(stems, matrices, strict=True)]

    return {"num_cameras": len(stems), "extrinsics": rows(poses), "intrinsics": rows(intrinsics)}


def _pipeline(request: Any) -> Any:
    half = bool(request.options["bf16"])
    if half not in _loaded:
        kind = importlib.import_module("hyworld2.worldrecon.pipeline").WorldMirrorPipeline
        weights = str(request.weights["worldmirror_2"])
        _loaded[half] = kind.from_pretrained(weights, subfolder="HY-WorldMirror-2.0", enable_bf16=half)
    return _loaded[half]


dxb_backend.serve(compose=compose)
