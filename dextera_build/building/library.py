"""The asset library as a folder: `index.json`, a gallery page, and one folder of files per asset, named by digest."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import UsageError
from dextera_build.explain.asset import Asset
from dextera_build.explain.library import MADE_BY, URDF, decoded
from dextera_build.report import gallery
from dextera_build.session import reading

if TYPE_CHECKING:
    from dextera_build.project.project import Project

FORM = 1
"""Version of `index.json`; it grows when a field changes its meaning, not when one is added."""
INDEX, PAGE, THUMBNAIL = "index.json", "index.html", "thumbnail.png"
_RULES = {kind: rule for rule, kind in MADE_BY.items()}


def write(project: Project, found: Iterable[Asset], folder: Path) -> list[Path]:
    """Write assets to a folder, and return the index and the page.

    Folders of assets are named by digest, so those that are there already are left as they are; assets that an earlier
    call wrote stay in the folder, but only `found` is in the index. The same assets give the same `index.json`.

    Raises:
        UsageError: The folder holds other things than a library.
    """
    if folder.is_dir() and any(folder.iterdir()) and not _is_library(folder / INDEX):
        raise UsageError(
            f"`{folder}` holds files that are no asset library",
            code="DXB-U217",
            hint="name a new or an empty folder; nothing in this one was changed",
        )
    folder.mkdir(parents=True, exist_ok=True)
    rows, pictures = [], {}
    for asset in found:
        place = folder / "assets" / asset.digest[:16]
        if not place.is_dir():
            _write_asset(project, asset, place)
        _add_urdf(project, asset, place)
        rows.append(asset.plain() | {"words": asset.words()} | _paths(folder, place))
        pictures[asset.digest] = (place / THUMBNAIL).read_bytes()
    (folder / INDEX).write_text(json.dumps({"form": FORM, "assets": rows}, indent=1, sort_keys=True) + "\n")
    (folder / PAGE).write_text(gallery.page(rows, pictures), encoding="utf-8")
    return [folder / INDEX, folder / PAGE]


def _is_library(index: Path) -> bool:
    try:
        return "form" in json.loads(index.read_bytes())
    except (OSError, ValueError, TypeError):
        return False


def _paths(folder: Path, place: Path) -> dict[str, Any]:
    """Files of an asset, relative to the library's folder."""
    meshes = sorted(path.relative_to(folder).as_posix() for path in place.glob("*.glb"))
    urdf = place / "urdf" / "object.urdf"
    return {
        "folder": place.relative_to(folder).as_posix(),
        "thumbnail": (place / THUMBNAIL).relative_to(folder).as_posix(),
        "meshes": meshes,
        "urdf": urdf.relative_to(folder).as_posix() if urdf.is_file() else "",
    }


def _write_asset(project: Project, asset: Asset, place: Path) -> None:
    """Write one folder: under another name first, so that a folder named by its digest is complete."""
    value = decoded(project, reading(project), _RULES[asset.kind], asset.digest)
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=".part-") as draft:
        new = Path(draft) / place.name
        new.mkdir()
        for name, mesh in _meshes(value, asset.kind).items():
            mesh.save(new / f"{name}.glb")
        (new / THUMBNAIL).write_bytes(_thumbnail(value, asset.kind))
        os.rename(new, place)


def _add_urdf(project: Project, asset: Asset, place: Path) -> None:
    """Write the object as URDF, if one was built; also later than the rest of its folder."""
    if not asset.urdf or (place / "urdf").is_dir():
        return
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=".part-") as draft:
        decoded(project, reading(project), URDF, asset.urdf).export(Path(draft) / "urdf", "object")
        os.rename(Path(draft) / "urdf", place / "urdf")


def _meshes(value: Any, kind: str) -> dict[str, Mesh]:
    """Textured meshes: the links of an object, or the seen and the invented part of a background."""
    if kind == "object":
        return {name: link.mesh for name, link in value.body.links.items()}
    return {"seen": value.mesh} | ({} if value.invented is None else {"invented": value.invented})


def _thumbnail(value: Any, kind: str) -> bytes:
    """PNG of the asset: an object by itself, a background as the photograph shows it without objects."""
    picture: bytes = value.body.picture() if kind == "object" else value.image.picture()
    return picture
