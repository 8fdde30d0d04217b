"""`Splats` as the PLY of the authors' code (Kerbl et al. 2023)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.formats.files import frame_comments, frame_of, suffix_among
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import COUNTS
from dextera_build.geometry import ply as table_files

_PLACE = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_TURN = ("rot_0", "rot_1", "rot_2", "rot_3")
_BASE = ("f_dc_0", "f_dc_1", "f_dc_2")
_UNUSED = {"nx", "ny", "nz", "red", "green", "blue"}
"""Columns that are not part of a Gaussian: the authors' code writes zeros as normals, viewers add colours."""
_LEAST = 1e-37
"""Replacement for opacities of 0; those of 1 are replaced by the next smaller float32, because their logits are
infinite."""


def ply(splats: Splats) -> bytes:
    """The PLY of the authors' code: logits of opacities, logarithms of scales, `f_rest` channel by channel.

    It is little-endian, and a comment names the frame.
    """
    count = len(splats.means)
    columns = dict(zip(_PLACE, splats.means.T, strict=True))
    columns |= dict.fromkeys(("nx", "ny", "nz"), np.zeros(count, np.float32))
    columns |= dict(zip(_BASE, splats.harmonics[:, 0].T, strict=True))
    rest = splats.harmonics[:, 1:].transpose(0, 2, 1).reshape(count, -1)
    columns |= {f"f_rest_{number}": column for number, column in enumerate(rest.T)}
    opacity = np.clip(splats.opacities.astype(np.float64), _LEAST, 1 - 2.0**-25)
    columns["opacity"] = np.log(opacity) - np.log1p(-opacity)
    columns |= dict(zip(_SCALES, np.log(splats.scales.astype(np.float64)).T, strict=True))
    columns |= dict(zip(_TURN, splats.rotations.T, strict=True))
    table = np.empty(count, [(name, "f4") for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table_files.written(table, frame_comments(splats.frame))


def save(splats: Splats, path: Path) -> list[Path]:
    """Write a PLY file."""
    path.write_bytes(ply(splats))
    return [path]


def load(path: str | Path, *, frame: str | None = None) -> Splats:
    """Read a PLY file with the columns of the authors' code, of degree 0 to 3.

    Args:
        path: The file.
        frame: Frame of its coordinates; None: as stated in a comment, otherwise "".

    Raises:
        ArtifactError: It is no PLY, or its columns are not those of 3D Gaussians.
    """
    suffix_among("Splats", Path(path), (".ply",))
    try:
        table, comments = table_files.read(Path(path).read_bytes())
        made = _gaussians({name: table[name] for name in table.dtype.names or ()})
    except (OSError, ValueError) as error:
        raise unreadable(path, "a PLY of 3D Gaussians", error) from None
    return Splats.of(made, frame_of(comments) if frame is None else frame)


def _gaussians(columns: dict[str, np.ndarray]) -> Gaussians:
    rest = [f"f_rest_{number}" for number in range(sum(name.startswith("f_rest_") for name in columns))]
    known = [*_PLACE, *_BASE, *rest, "opacity", *_SCALES, *_TURN]
    missing = [name for name in known if name not in columns]
    if missing:
        raise ValueError(f"it has no property `{missing[0]}`")
    if further := columns.keys() - {*known} - _UNUSED:
        raise ValueError(f"property `{min(further)}` would be lost; it may change the meaning of the others")
    if len(rest) % 3 or len(rest) // 3 + 1 not in COUNTS:
        raise ValueError(f"{len(rest)} properties `f_rest_...` are no degree: 0, 9, 24 or 45 are")

    def block(names: tuple[str, ...] | list[str]) -> np.ndarray:
        return np.stack([columns[name].astype(np.float64) for name in names], axis=1)

    turns = block(_TURN)
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    if not (length > 0).all():
        raise ValueError(f"{int((length == 0).sum()):,} quaternions are zero")
    base = block(_BASE)[:, None]
    if rest:
        base = np.concatenate([base, block(rest).reshape(len(base), 3, -1).transpose(0, 2, 1)], axis=1)
    with np.errstate(over="ignore"):  # non-finite values are refused by the type, with their number
        opacities, scales = 1 / (1 + np.exp(-columns["opacity"].astype(np.float64))), np.exp(block(_SCALES))
    return Gaussians(block(_PLACE), turns / length, scales, opacities, base)
