"""Limits on what a file expands to: a few lines with instances of instances can stand for billions of parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from dextera_build.errors import ArtifactError
from dextera_build.geometry.baking import LARGEST_PX, Part

MOST_TRIANGLES = 20_000_000
"""Most triangles of a mesh file with all its instances."""
MOST_VERTICES = 100_000_000
"""Most vertices; those of a mesh count once for each of its materials."""
MOST_PARTS = 50_000
"""Most parts of a scene: nodes, prims or elements, with all their instances."""
_REDUCE = "reduce it in a modelling program; a part that has instances counts once for each of them"


def check(path: str | Path, things: str, count: int, most: int, hint: str = _REDUCE) -> None:
    """Refuse a file that holds too many `things`.

    Args:
        path: The file.
        things: Plural noun.
        count: How many were found, at least.
        most: How many are allowed.
        hint: Next step.

    Raises:
        ArtifactError: `count` exceeds `most`.
    """
    if count > most:
        raise ArtifactError(
            f"`{Path(path).name}` holds too many {things}",
            code="DXB-A407",
            facts={"found": f"at least {count:,}", "most": f"{most:,}"},
            hint=hint,
        )


def few(parts: Iterable[Part], path: str | Path) -> Iterator[Part]:
    """The same parts of a mesh file.

    Raises:
        ArtifactError: They have too many triangles, vertices or texels together.
    """
    triangles = vertices = texels = 0
    for part in parts:
        triangles, vertices = triangles + len(part.faces), vertices + len(part.vertices)
        check(path, "triangles", triangles, MOST_TRIANGLES)
        check(path, "vertices", vertices, MOST_VERTICES)
        if part.picture is not None:
            texels += part.picture.shape[0] * part.picture.shape[1]
            check(path, "texels", texels, LARGEST_PX**2)
        yield part
