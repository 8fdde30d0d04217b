"""`Splats` in the small formats that web viewers load: `.splat` of antimatter15 and `.spz` of Niantic, version 2.

Both round: `.splat` has one colour per Gaussian, `.spz` keeps the harmonics. https://github.com/antimatter15/splat,
https://github.com/nianticlabs/spz.
"""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.formats.files import unwritable
from dextera_build.gaussians.spherical_harmonics import COUNTS

_C0 = 0.28209479177387814
"""The first spherical harmonic."""
_SPLAT = np.dtype([("at", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("turn", "u1", 4)])
_MAGIC, _VERSION = 0x5053474E, 2
_FRACTION_BITS = 12
"""Of positions in `.spz`, which have 24 bits: steps of 0.24 mm, up to 2,048 m from the origin."""
_COLOUR = 0.15
"""Scale of the first coefficients in `.spz`."""
_BUCKETS = (8, 16)
"""Steps of the harmonics of degree 1, and of higher degrees, in 1/128 of a coefficient."""


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def save_splat(splats: Splats, path: Path) -> list[Path]:
    """Write 32 bytes per Gaussian, the largest and most opaque first; only the mean colour is kept."""
    table = np.empty(len(splats.means), _SPLAT)
    table["at"], table["scale"] = splats.means, splats.scales
    table["rgba"][:, :3] = _bytes(255 * (0.5 + _C0 * splats.harmonics[:, 0]))
    table["rgba"][:, 3] = _bytes(255 * splats.opacities)
    table["turn"] = _bytes(splats.rotations * 128 + 128)
    order = np.argsort(-splats.scales.prod(axis=1, dtype=np.float64) * splats.opacities, kind="stable")
    path.write_bytes(table[order].tobytes())
    return [path]


def save_spz(splats: Splats, path: Path) -> list[Path]:
    """Write the compressed columns.

    Raises:
        ArtifactError: A centre is too far from the origin for 24 bits.
    """
    steps = np.round(splats.means.astype(np.float64) * 2**_FRACTION_BITS)
    if len(steps) and np.abs(steps).max() >= 2**23:
        raise unwritable("Splats", "SPZ", f"a centre is more than {2 ** (23 - _FRACTION_BITS):,} m from the origin")
    degree = COUNTS.index(splats.harmonics.shape[1])
    columns = [
        steps.astype("<i4").reshape(-1, 1).view(np.uint8).reshape(-1, 4)[:, :3],
        _bytes(255 * splats.opacities),
        _bytes(255 * (0.5 + _COLOUR * splats.harmonics[:, 0])),
        _bytes(16 * (np.log(splats.scales.astype(np.float64)) + 10)),
        _turns(splats.rotations.astype(np.float64)),
        _harmonics(splats.harmonics[:, 1:].astype(np.float64)),
    ]
    head = struct.pack("<IIIBBBB", _MAGIC, _VERSION, len(splats.means), degree, _FRACTION_BITS, 0, 0)
    body = b"".join(np.ascontiguousarray(column).tobytes() for column in columns)
    path.write_bytes(gzip.compress(head + body, mtime=0))
    return [path]


def _turns(rotations: np.ndarray) -> np.ndarray:
    """x, y and z (N, 3) of unit quaternions w, x, y, z (N, 4) whose w is made positive."""
    signed = rotations[:, 1:] * np.where(rotations[:, :1] < 0, -1.0, 1.0)
    return _bytes(127.5 * signed + 127.5)


def _harmonics(rest: np.ndarray) -> np.ndarray:
    """Coefficients (N, K, 3) above degree 0, in buckets."""
    bucket = np.where(np.arange(rest.shape[1]) < 3, *_BUCKETS)[None, :, None]
    return _bytes((np.round(128 * rest) + 128 + bucket // 2) // bucket * bucket)
