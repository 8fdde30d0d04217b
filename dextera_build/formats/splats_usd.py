"""`Splats` as USD: one prim `UsdVol.ParticleField3DGaussianSplat`, the schema of OpenUSD 26.03 and later."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.formats import stage_files
from dextera_build.formats.files import suffix_among
from dextera_build.gaussians.arrays import Gaussians, moved
from dextera_build.gaussians.spherical_harmonics import COUNTS
from dextera_build.geometry import transforms

_FRAME = "frame"
"""Name in the prim's custom data."""
_SIDE_SIGMAS = 3.0
"""The extent reaches so many standard deviations beyond the means."""


def save(splats: Splats, path: Path) -> list[Path]:
    """Write a stage with z up, in metres; its default prim contains the Gaussians with consecutive coefficients.

    Args:
        splats: The Gaussians.
        path: `.usda`, `.usdc`, `.usd` or `.usdz`.
    """
    if path.suffix.lower() == ".usdz":
        return stage_files.packed(path, lambda inner: save(splats, inner))
    from pxr import Usd, UsdGeom, UsdVol, Vt

    stage = Usd.Stage.CreateNew(str(path)) if not path.exists() else _emptied(path)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/Splats")
    stage.SetDefaultPrim(field.GetPrim())
    if splats.frame:
        field.GetPrim().SetCustomDataByKey(_FRAME, splats.frame)
    field.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(splats.means))
    # Memory order of a quaternion in USD is x, y, z, w.
    field.CreateOrientationsAttr(Vt.QuatfArray.FromNumpy(np.roll(splats.rotations, -1, axis=1)))
    field.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(splats.scales))
    field.CreateOpacitiesAttr(Vt.FloatArray.FromNumpy(splats.opacities))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(COUNTS.index(splats.harmonics.shape[1]))
    coefficients = np.ascontiguousarray(splats.harmonics.reshape(-1, 3))
    field.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray.FromNumpy(coefficients))
    reach = _SIDE_SIGMAS * splats.scales.max(axis=1, keepdims=True)
    if len(splats.means):
        extent = np.stack([(splats.means - reach).min(axis=0), (splats.means + reach).max(axis=0)])
        field.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent.astype(np.float32)))
    stage.GetRootLayer().Save()
    return [path]


def load(path: str | Path, *, frame: str | None = None) -> Splats:
    """Read the one `ParticleField3DGaussianSplat` of a USD file, in float or half, into metres with z up.

    Args:
        path: The file.
        frame: Frame of its coordinates; None: as stated in the prim's custom data, otherwise "".

    Raises:
        ArtifactError: It is no USD, or does not contain exactly one such prim with arrays of equal length.
    """
    from pxr import Usd, UsdGeom, UsdVol

    suffix_among(Splats.name(), Path(path), (".usda", ".usdc", ".usd", ".usdz"))
    try:
        stage = stage_files.opened(Path(path), Path(path).parent)
    except ValueError as error:
        raise unreadable(path, "USD", error) from None
    fields = [prim for prim in stage.Traverse() if prim.IsA(UsdVol.ParticleField3DGaussianSplat)]
    if len(fields) != 1:
        raise unreadable(path, "USD of 3D Gaussians", f"it holds {len(fields)} prims `ParticleField3DGaussianSplat`")
    try:
        made = _gaussians(UsdVol.ParticleField3DGaussianSplat(fields[0]))
        placed = np.array(UsdGeom.Xformable(fields[0]).ComputeLocalToWorldTransform(Usd.TimeCode.Default())).T
        scale, motion = _similarity(placed)
        unit, up = stage_files.units(stage)
    except ValueError as error:
        raise unreadable(path, "USD of 3D Gaussians", error) from None
    if up == "y":
        motion = transforms.rigid(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3)) @ motion
    motion = transforms.rigid(motion[:3, :3], unit * motion[:3, 3])
    told = fields[0].GetCustomDataByKey(_FRAME) or ""
    same = scale * unit == 1 and np.array_equal(motion, np.eye(4))
    return Splats.of(made if same else moved(made, motion, scale * unit), str(told) if frame is None else frame)


def _emptied(path: Path) -> Any:
    from pxr import Usd

    path.unlink()
    return Usd.Stage.CreateNew(str(path))


def _gaussians(field: Any) -> Gaussians:
    def numbers(name: str, width: int) -> np.ndarray:
        attribute = field.GetPrim().GetAttribute(name)
        found = attribute.Get() if attribute else None
        if found is None:
            half = field.GetPrim().GetAttribute(f"{name}h")
            found = half.Get() if half else None
        if found is None:
            raise ValueError(f"`{name}` is not authored")
        return np.array(found, dtype=np.float64).reshape(-1, width) if width else np.array(found, dtype=np.float64)

    means, scales, opacities = numbers("positions", 3), numbers("scales", 3), numbers("opacities", 0)
    turns = _quaternions(field)
    coefficients = numbers("radiance:sphericalHarmonicsCoefficients", 3)
    degree = field.GetRadianceSphericalHarmonicsDegreeAttr().Get()
    if degree not in range(len(COUNTS)):
        raise ValueError(f"the colours are of degree {degree}; 0 to 3 are read")
    lengths = {len(means), len(scales), len(opacities), len(turns), len(coefficients) / COUNTS[degree]}
    if len(lengths) > 1:
        raise ValueError(f"its arrays are of different lengths: {sorted(lengths)}")
    return Gaussians(means, turns, scales, opacities, coefficients.reshape(len(means), -1, 3))


def _quaternions(field: Any) -> np.ndarray:
    found = field.GetOrientationsAttr().Get() or field.GetOrientationshAttr().Get() or []
    turns = np.array([(q.real, *q.imaginary) for q in found], np.float64).reshape(-1, 4)
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    if not (length > 0).all():
        raise ValueError(f"{int((length == 0).sum()):,} quaternions are zero")
    return np.asarray(turns / length)


def _similarity(matrix: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and (4, 4) rigid part of a transform; raises ValueError for any other transform."""
    linear = matrix[:3, :3]
    scale = float(np.cbrt(np.linalg.det(linear)))
    if not scale > 0 or np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > 1e-6:
        raise ValueError("its transform mirrors, shears or scales unevenly")
    return scale, transforms.rigid(linear / scale, matrix[:3, 3])
