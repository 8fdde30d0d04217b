"""Third-party USD stages, opened after checks that all layers are inside the input and that prims are limited.

Composition multiplies prims: a few lines of text can define ten references to a prim with ten references.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dextera_build.formats import bounds, named_files
from dextera_build.formats.files import unwritable

_MOST_SPECS = 1_000
"""Maximum number of prim specs that one prim is composed of; each level of two references to prims with two doubles
it."""

_SAID = re.compile(r"^\s*Error in '.*?' at line \d+ in file \S+ : '(.*?)'$", re.MULTILINE | re.DOTALL)


def opened(path: Path, folder: Path) -> Any:
    """The `Usd.Stage` of a file.

    Args:
        path: The file.
        folder: Folder with all layers that it names, by sublayers, references and payloads.

    Raises:
        ValueError: A layer is missing, damaged or outside of `folder`, or a prim has value clips.
        ArtifactError: It has more than `bounds.MOST_PARTS` prims.
    """
    from pxr import Tf, Usd

    try:
        layers = _layers(path, folder)
        _check_prims(path, layers[0])
        return Usd.Stage.Open(layers[0])
    except Tf.ErrorException as error:
        raise ValueError(said(error)) from None


def units(stage: Any) -> tuple[float, str]:
    """Metres per unit of a stage, and its up axis, `y` or `z`.

    Raises:
        ValueError: One of them holds a value of another type, or the axis is another.
    """
    from pxr import Tf, UsdGeom

    try:
        unit, up = UsdGeom.GetStageMetersPerUnit(stage), str(UsdGeom.GetStageUpAxis(stage)).lower()
    except Tf.ErrorException as error:
        raise ValueError(said(error)) from None
    if up not in ("y", "z"):
        raise ValueError(f"its up axis is `{up}`, neither `Y` nor `Z`")
    return unit, up


def packed(path: Path, write: Callable[[Path], object]) -> list[Path]:
    """Write a package `.usdz` of a stage and all files that it names.

    Args:
        path: The package.
        write: Writes the stage as the file that it is given, and its other files next to it.
    """
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder, f"{path.stem}.usdc")
        write(stage)
        return package(path, stage)


def package(path: Path, stage: Path) -> list[Path]:
    """Write a package `.usdz` of a stage that exists.

    Raises:
        ArtifactError: A file that it names is missing.
    """
    from pxr import Sdf, UsdUtils

    path.unlink(missing_ok=True)
    if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(stage)), str(path)):
        raise unwritable("stage", "USDZ", "a file that it names cannot be read")
    return [path]


def said(error: Any) -> str:
    """What USD says last in a `Tf.ErrorException`, which lists its errors with functions and lines of its source."""
    found = _SAID.findall(str(error))
    return " ".join(found[-1].split()) if found else " ".join(str(error).split())


def outer(name: str) -> str:
    """Path of the file that contains an asset: the package for an asset in a `.usdz`."""
    from pxr import Ar

    return str(Ar.SplitPackageRelativePathOuter(name)[0]) if Ar.IsPackageRelativePath(name) else name


def _layers(path: Path, folder: Path) -> list[Any]:
    """All layers of a stage, the root first, opened one by one without composition."""
    from pxr import Sdf

    if not path.is_file():
        raise ValueError("there is no such file")
    layers = [Sdf.Layer.FindOrOpen(str(path.absolute()))]
    for layer in layers:
        for name in filter(None, layer.GetCompositionAssetDependencies()):  # empty for the layer itself
            other = _named(layer, name, folder)
            if other not in layers:
                layers.append(other)
    return layers


def _named(layer: Any, name: str, folder: Path) -> Any:
    """The layer that another one names."""
    from pxr import Sdf

    bare, arguments = Sdf.Layer.SplitIdentifier(name)
    whole, beside = Sdf.ComputeAssetPathRelativeToLayer(layer, bare), Path(outer(layer.realPath))
    if outer(whole) != str(beside):  # not in the same package
        named_files.found(outer(bare), beside, folder)
    found = Sdf.Layer.FindOrOpen(whole, arguments)
    if found is None:
        raise ValueError(f"`{name}`, which `{beside.name}` names, is no layer")
    return found


def _check_prims(path: Path, root: Any) -> None:
    """Compose prims one by one; raises for a stage with too many, or with value clips."""
    from pxr import Pcp, Sdf

    cache = Pcp.Cache(Pcp.LayerStackIdentifier(root), "usd", True)
    waiting, count = [Sdf.Path("/")], 0
    while waiting:
        place = waiting.pop()
        index, _ = cache.ComputePrimIndex(place)
        if index.hasAnyPayloads:
            cache.RequestPayloads([place], [])
            index, _ = cache.ComputePrimIndex(place)
        bounds.check(path, "references to one prim", len(index.primStack), _MOST_SPECS)
        if any(spec.HasInfo("clips") for spec in index.primStack):
            raise ValueError(f"`{place}` has value clips, which are not read; write one time as a plain file")
        names, _ = index.ComputePrimChildNames()
        waiting += map(place.AppendChild, names)
        count += len(names)
        bounds.check(path, "prims", count, bounds.MOST_PARTS)
