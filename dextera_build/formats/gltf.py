"""Checks of a GLB before it is read: numbers missing in the file, and pictures that a reader would silently drop.

https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dextera_build.artifacts.cameras.image import opened
from dextera_build.formats import bounds

_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Type of an accessor -> numbers of an element."""
_MOST_NUMBERS = 10 * bounds.MOST_TRIANGLES
"""Maximum total number of values in all accessors; one without a view is all zeros, and views may overlap."""


def check(path: Path) -> set[str]:
    """Raise for a GLB that expands to too much or has unreadable pictures; return the names of its buffers.

    Raises:
        ValueError: It is damaged.
        ArtifactError: Its accessors have too many numbers, or its primitives too many vertices.
    """
    data = path.read_bytes()
    end = 20 + int.from_bytes(data[12:16], "little")
    try:
        header = json.loads(data[20:end])
        columns = [each["count"] * _COLUMNS[each["type"]] for each in header.get("accessors", ())]
        used = sum(_vertices(header, each) for mesh in header.get("meshes", ()) for each in mesh["primitives"])
        buffers = {str(each["uri"]) for each in header.get("buffers", ()) if "uri" in each}
        views = [_view(header, each, data[end + 8 :]) for each in header.get("images", ())]
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"its JSON is damaged: {error}") from None
    bounds.check(path, "numbers", sum(columns), _MOST_NUMBERS)
    bounds.check(path, "vertices", used, bounds.MOST_VERTICES)
    for number, view in enumerate(views):
        if view is not None:
            opened(view, f"image {number}")
    return buffers


def _vertices(header: Mapping[str, Any], primitive: Mapping[str, Any]) -> int:
    """Vertices and indices of a primitive; many may share an accessor."""
    accessors = [primitive["attributes"].get("POSITION"), primitive.get("indices")]
    return sum(header["accessors"][each]["count"] for each in accessors if each is not None)


def _view(header: Mapping[str, Any], image: Mapping[str, Any], binary: bytes) -> bytes | None:
    """Content of an embedded picture; None for others, and for unsupported forms."""
    if "bufferView" not in image or image.get("mimeType") == "image/ktx2":
        return None
    view = header["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    return binary[start : start + view["byteLength"]]
