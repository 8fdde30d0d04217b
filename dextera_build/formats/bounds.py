"""Limits on the expanded size of a file: a few lines with nested instances can represent billions of parts."""

from __future__ import annotations

from pathlib import Path

from dextera_build.errors import ArtifactError

MOST_TRIANGLES = 20_000_000
"""Maximum number of triangles of a mesh file with all its instances."""
MOST_VERTICES = 100_000_000
"""Maximum number of vertices; those of a mesh count once for each of its materials."""
MOST_PARTS = 50_000
"""Maximum number of parts of a scene: nodes, prims or elements, with all their instances."""
_REDUCE = "reduce it in a modelling program; a part that has instances counts once for each of them"


def check(path: str | Path, things: str, count: int, most: int, hint: str = _REDUCE) -> None:
    """Raise for a file that contains too many `things`.

    Args:
        path: The file.
        things: Plural noun.
        count: Lower bound of their number.
        most: Maximum allowed number.
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
