"""Feature maps of networks, with NPZ as their file format."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.arrays import save_arrays
from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.formats import suffix_among, unreadable
from dextera_build.artifacts.image import png

_FORM = "NPZ of a feature map"
_SIDE_PX = 240
"""Smallest longer side of a preview."""
_UNREADABLE = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error)


class FeatureMap(Artifact):
    """Output of a network for each cell of a grid over a picture."""

    saves: ClassVar[tuple[str, ...]] = (".npz",)

    features: Annotated[np.ndarray, Array("R C D", "float32")]
    """One vector per cell: rows from the top, columns from the left."""
    width: PositiveInt
    """Width of the picture [px]."""
    height: PositiveInt
    """Height of the picture [px]."""
    network: str
    """Name and version of the network, with the layer."""

    def facts(self) -> Iterator[str]:
        """Cells, length of the vectors, the picture and the network."""
        rows, columns, length = self.features.shape
        yield f"{columns} x {rows} cells"
        yield f"{length} features"
        yield f"{self.width} x {self.height} px"
        yield self.network

    def centres(self) -> np.ndarray:
        """Column and row of each cell's centre in the picture, (R, C, 2) float64, integer pixel centres [px]."""
        rows, columns, _ = self.features.shape
        row, column = np.indices((rows, columns), dtype=np.float64)
        across = (column + 0.5) * self.width / columns - 0.5
        return np.stack([across, (row + 0.5) * self.height / rows - 0.5], axis=-1)

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """Vectors (N, D) float64 at pixels (N, 2), column and row: bilinear between centres, constant beyond them."""
        rows, columns, _ = self.features.shape
        cells = (np.asarray(pixels, np.float64) + 0.5) / [self.width / columns, self.height / rows] - 0.5
        cells = cells.clip(0, [columns - 1, rows - 1])
        first = np.minimum(cells.astype(np.int64), [max(columns - 2, 0), max(rows - 2, 0)])
        part = cells - first
        found = np.zeros((len(cells), self.features.shape[2]))
        for below in (0, 1):
            for right in (0, 1):
                column, row = np.minimum(first + np.array([right, below]), [columns - 1, rows - 1]).T
                share = np.abs(1 - right - part[:, 0]) * np.abs(1 - below - part[:, 1])
                found += share[:, None] * self.features[row, column]
        return found

    def picture(self) -> bytes | None:
        """The first three principal components as red, green and blue, each over its whole range."""
        rows, columns, length = self.features.shape
        if not rows * columns * length:
            return None
        flat = self.features.reshape(-1, length).astype(np.float64)
        flat = (flat - flat.mean(axis=0)) / max(float(np.abs(flat).max()), 1e-300)
        axes = np.linalg.eigh(flat.T @ flat)[1][:, ::-1][:, :3]
        # The sign of an eigenvector is arbitrary: its largest component is made positive, for a deterministic picture.
        axes = axes * np.sign(axes[np.abs(axes).argmax(axis=0), np.arange(axes.shape[1])])
        values = np.pad(flat @ axes, ((0, 0), (0, 3 - axes.shape[1])))
        low, span = values.min(axis=0), np.ptp(values, axis=0)
        shades = np.round(255 * (values - low) / np.where(span > 0, span, 1)).astype(np.uint8)
        step = -(-_SIDE_PX // max(rows, columns))
        return png(shades.reshape(rows, columns, 3).repeat(step, axis=0).repeat(step, axis=1))

    def _write(self, path: Path) -> list[Path]:
        size = np.array([self.width, self.height], np.int64)
        arrays = {"features": self.features, "size": size, "network": np.array(self.network)}
        save_arrays(path, arrays)
        return [path]

    @classmethod
    def load(cls, path: str | Path) -> FeatureMap:
        """Read an NPZ file with `features` (R, C, D), `size` (width, height) [px] and `network`; never a pickle.

        Floats of other widths are converted to float32.

        Raises:
            ArtifactError: It is no NPZ, lacks one of the arrays, or one is not of this form.
        """
        suffix_among(cls.name(), Path(path), cls.saves)
        try:
            opened = np.load(path, allow_pickle=False)
            if not isinstance(opened, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array")
            with opened as archive:
                fields = _fields(archive)
        except _UNREADABLE as error:
            raise unreadable(path, _FORM, error) from None
        return cls(**fields)


def _fields(archive: Any) -> dict[str, Any]:
    missing = [name for name in ("features", "size", "network") if name not in archive.files]
    if missing:
        raise ValueError(f"it has no array `{missing[0]}`")
    features, size, network = archive["features"], archive["size"], archive["network"]
    if features.dtype.kind != "f" or size.shape != (2,) or size.dtype.kind not in "iu" or network.dtype.kind != "U":
        raise ValueError("`features` are not floats, `size` is not two whole numbers, or `network` is no text")
    return {
        "features": features.astype(np.float32),
        "width": int(size[0]),
        "height": int(size[1]),
        "network": str(network),
    }
