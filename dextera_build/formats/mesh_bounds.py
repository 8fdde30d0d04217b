"""Limits on the parts of a mesh file, checked while they are read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from dextera_build.formats import bounds
from dextera_build.geometry.baking import LARGEST_PX, Part


def few(parts: Iterable[Part], path: str | Path) -> Iterator[Part]:
    """The unchanged parts of a mesh file, within the limits.

    Raises:
        ArtifactError: They have too many triangles, vertices or texels together.
    """
    triangles = vertices = texels = 0
    for part in parts:
        triangles, vertices = triangles + len(part.faces), vertices + len(part.vertices)
        bounds.check(path, "triangles", triangles, bounds.MOST_TRIANGLES)
        bounds.check(path, "vertices", vertices, bounds.MOST_VERTICES)
        if part.picture is not None:
            texels += part.picture.shape[0] * part.picture.shape[1]
            bounds.check(path, "texels", texels, LARGEST_PX**2)
        yield part
