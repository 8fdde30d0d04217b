"""`Splats` as PLY, USD, or in the small formats of web viewers, by the suffix."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.formats import splats_packed, splats_ply, splats_usd


def save(splats: Splats, path: Path) -> list[Path]:
    """Write PLY, USD, `.splat` or `.spz`."""
    forms = {".ply": splats_ply.save, ".splat": splats_packed.save_splat, ".spz": splats_packed.save_spz}
    return forms.get(path.suffix.lower(), splats_usd.save)(splats, path)


def load(path: str | Path, *, frame: str | None = None) -> Splats:
    """Read PLY or USD; see `splats_ply.load` and `splats_usd.load`.

    Args:
        path: The file.
        frame: Frame of its coordinates; None: as stated in the file, otherwise "".

    Raises:
        ArtifactError: It is neither, or does not hold Gaussians.
    """
    load_form = splats_ply.load if Path(path).suffix.lower() == ".ply" else splats_usd.load
    return load_form(path, frame=frame)
