"""3D Gaussians for appearance, with the PLY of the authors' code (Kerbl et al. 2023) and USD as file formats."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.formats import frame_comments, frame_of, module, suffix_among, unreadable
from dextera_build.artifacts.image import Image, png
from dextera_build.artifacts.pose import Pose, Similarity, check_frame
from dextera_build.errors import ArtifactError
from dextera_build.gaussians import arrays, splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import COUNTS
from dextera_build.geometry import ply

_PLACE = ("x", "y", "z")
_SCALES = ("scale_0", "scale_1", "scale_2")
_TURN = ("rot_0", "rot_1", "rot_2", "rot_3")
_BASE = ("f_dc_0", "f_dc_1", "f_dc_2")
_UNUSED = {"nx", "ny", "nz", "red", "green", "blue"}
"""Columns that are not part of a Gaussian: the authors' code writes zeros as normals, viewers add colours."""
_LEAST = 1e-37
"""Replacement for opacities of 0; those of 1 are replaced by the next smaller float32, because their logits are
infinite."""


class Splats(Artifact):
    """3D Gaussians with view-dependent colours."""

    saves: ClassVar[tuple[str, ...]] = (".ply", ".usda", ".usdc", ".usd")

    means: Annotated[np.ndarray, Array("N 3", "float32", unit="m", frame="frame")]
    """Centres."""
    rotations: Annotated[np.ndarray, Array("N 4", "float32", frame="frame")]
    """Unit quaternions w, x, y, z: the ellipsoid's axes in the frame."""
    scales: Annotated[np.ndarray, Array("N 3", "float32", unit="m")]
    """Standard deviation along each axis of the ellipsoid, above 0."""
    opacities: Annotated[np.ndarray, Array("N", "float32")]
    """0..1."""
    harmonics: Annotated[np.ndarray, Array("N K 3", "float32", frame="frame")]
    """Coefficients of red, green and blue in the order of `geometry.spherical_harmonics`; K is 1, 4, 9 or 16. 0.5 plus
    their sum in a direction is sRGB 0..1."""
    frame: str = Field("", pattern="^[ -~]*$")
    """Frame of the coordinates; "" if not stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        length = np.linalg.norm(self.rotations.astype(np.float64), axis=1)
        faults = {
            "rotations": (np.abs(length - 1) > 1e-3, "are of another length than 1"),
            "scales": ((self.scales <= 0).any(axis=1), "are not above 0"),
            "opacities": ((self.opacities < 0) | (self.opacities > 1), "are outside 0..1"),
        }
        for name, (wrong, what) in faults.items():
            if wrong.any():
                raise ArtifactError(
                    f"Splats.{name}: {int(wrong.sum()):,} of {len(wrong):,} {what}",
                    code="DXB-A405",
                    hint="the fields hold the values themselves, not the logits and logarithms of a PLY file",
                )
        if self.harmonics.shape[1] not in COUNTS:
            raise ArtifactError(
                f"Splats.harmonics: {self.harmonics.shape[1]} coefficients are no degree",
                code="DXB-A406",
                hint="degree 0, 1, 2 or 3 has 1, 4, 9 or 16 coefficients",
            )
        return self

    @property
    def gaussians(self) -> Gaussians:
        """The same in float64."""
        return Gaussians(
            self.means.astype(np.float64),
            self.rotations.astype(np.float64),
            self.scales.astype(np.float64),
            self.opacities.astype(np.float64),
            self.harmonics.astype(np.float64),
        )

    @classmethod
    def of(cls, made: Gaussians, frame: str = "") -> Splats:
        """Gaussians rounded to float32."""
        turns = made.rotations / np.linalg.norm(made.rotations, axis=1, keepdims=True)
        arrays = {"means": made.means, "rotations": turns, "scales": made.scales}
        arrays |= {"opacities": made.opacities, "harmonics": made.harmonics}
        return cls(**{name: array.astype(np.float32) for name, array in arrays.items()}, frame=frame)

    def facts(self) -> Iterator[str]:
        """Number of Gaussians, extent, degree of the colours, and the frame."""
        yield f"{len(self.means):,} Gaussians"
        if len(self.means):
            yield " x ".join(f"{1000 * length:.0f}" for length in np.ptp(self.means, axis=0)) + " mm"
        yield f"degree {COUNTS.index(self.harmonics.shape[1])}"
        if self.frame:
            yield f"frame {self.frame}"

    def picture(self) -> bytes:
        """The Gaussians from their front left and above."""
        return png(splatting.preview(self.gaussians))

    def seen(self, camera: Camera, camera_pose: Pose) -> Image:
        """The rendering by a camera over black; a preview renderer, seconds for 100,000 Gaussians.

        Args:
            camera: Intrinsics.
            camera_pose: T_frame_camera, OpenCV axes.

        Raises:
            ArtifactError: The pose is in another frame.
        """
        check_frame(self.name(), self.frame, camera_pose.inverse())
        size = (camera.height, camera.width)
        light = splatting.render(self.gaussians, camera.matrix(), camera_pose.matrix, size)
        return Image(pixels=np.round(255 * light.clip(0, 1)).astype(np.uint8))

    def moved(self, motion: Pose | Similarity) -> Splats:
        """The same Gaussians in the parent frame of `motion`, with their view-dependent colours rotated.

        Raises:
            ArtifactError: Their frame is not its child.
        """
        check_frame(self.name(), self.frame, motion)
        scale = motion.scale if isinstance(motion, Similarity) else 1.0
        return Splats.of(arrays.moved(self.gaussians, motion.matrix, scale), motion.parent)

    def ply(self) -> bytes:
        """The PLY of the authors' code: logits of opacities, logarithms of scales, `f_rest` channel by channel.

        It is little-endian, and a comment names the frame.
        """
        count = len(self.means)
        columns = dict(zip(_PLACE, self.means.T, strict=True))
        columns |= dict.fromkeys(("nx", "ny", "nz"), np.zeros(count, np.float32))
        columns |= dict(zip(_BASE, self.harmonics[:, 0].T, strict=True))
        rest = self.harmonics[:, 1:].transpose(0, 2, 1).reshape(count, -1)
        columns |= {f"f_rest_{number}": column for number, column in enumerate(rest.T)}
        opacity = np.clip(self.opacities.astype(np.float64), _LEAST, 1 - 2.0**-25)
        columns["opacity"] = np.log(opacity) - np.log1p(-opacity)
        columns |= dict(zip(_SCALES, np.log(self.scales.astype(np.float64)).T, strict=True))
        columns |= dict(zip(_TURN, self.rotations.T, strict=True))
        table = np.empty(count, [(name, "f4") for name in columns])
        for name, column in columns.items():
            table[name] = column
        return ply.written(table, frame_comments(self.frame))

    def _write(self, path: Path) -> list[Path]:
        if path.suffix.lower() == ".ply":
            path.write_bytes(self.ply())
        else:
            module("splats_usd").write(self, path)
        return [path]

    @classmethod
    def load(cls, path: str | Path, *, frame: str | None = None) -> Splats:
        """Read a PLY file with the columns of the authors' code, of degree 0 to 3; `splats_usd.load` reads USD.

        Args:
            path: The file.
            frame: Frame of its coordinates; None: as stated in a comment, otherwise "".

        Raises:
            ArtifactError: It is no PLY, or its columns are not those of 3D Gaussians.
        """
        suffix_among(cls.name(), Path(path), (".ply",))
        try:
            table, comments = ply.read(Path(path).read_bytes())
            made = _gaussians({name: table[name] for name in table.dtype.names or ()})
        except (OSError, ValueError) as error:
            raise unreadable(path, "a PLY of 3D Gaussians", error) from None
        return cls.of(made, frame_of(comments) if frame is None else frame)


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
