"""Resolution of files named in a robot's description: meshes by relative paths and by `package://`."""

from __future__ import annotations

import difflib
import posixpath
import re
from collections.abc import Mapping

import numpy as np

from dextera_build.errors import RuleError, listing
from dextera_build.formats import bounds
from dextera_build.sim.model.imported import collada

MESHES = (".stl", ".obj", ".dae")
"""Mesh formats that are read."""
MOST_TEXELS = 1 << 26
"""Maximum number of texels of a texture, and of cells of a height field."""


def wrong(message: str, hint: str | None = None, **facts: object) -> RuleError:
    """The error for a robot's file."""
    return RuleError(message, code="DXB-B217", facts=facts, hint=hint)


def found(name: str, beside: str, files: Mapping[str, bytes]) -> str:
    """The path in `files` that a description refers to.

    Args:
        name: `package://robot/meshes/a.stl`, `../meshes/a.stl`.
        beside: Path of the description, to which relative names are relative.
        files: Path -> content.

    Raises:
        RuleError: There is no such file, or several.
    """
    plain = re.sub(r"^(package|model|file)://", "", name.strip()).replace("\\", "/")
    near = posixpath.normpath(posixpath.join(posixpath.dirname(beside), plain))
    whole = posixpath.normpath(plain).lstrip("/")
    for path in (near, whole):
        if path in files:
            return path
    # A package may be anywhere in the folder, and the folder may be a part of a package.
    parts = whole.removeprefix("../").split("/")
    for start in range(len(parts)):
        tail = "/".join(part for part in parts[start:] if part != "..")
        ends = [path for path in files if path == tail or path.endswith(f"/{tail}")]
        if len(ends) == 1:
            return ends[0]
        if len(ends) > 1:
            raise wrong(
                f"which file `{name}` means is not clear", files=listing(ends), hint="leave one of them in the folder"
            )
    close = difflib.get_close_matches(parts[-1], [posixpath.basename(path) for path in files], n=3, cutoff=0.5)
    raise wrong(
        f"mesh `{name}` is missing",
        named_in=beside,
        similar=listing(close) or "none",
        here=listing(sorted({posixpath.dirname(path) or "." for path in files})),
        hint="put the package's `meshes` folder next to the description",
    )


def mesh(path: str, data: bytes) -> tuple[str, bytes]:
    """A mesh for MuJoCo: the file's name with the suffix of its format, and its bytes.

    Raises:
        RuleError: It has another format, or is damaged.
    """
    stem, suffix = posixpath.splitext(posixpath.basename(path))
    form = suffix.lower()
    if form == ".dae":
        return f"{stem}.obj", collada.as_obj(path, data)
    if form == ".stl":
        return (f"{stem}.stl", data) if _is_binary(data) else (f"{stem}.obj", _obj_of_text(path, data))
    if form == ".obj":
        return f"{stem}.obj", data
    raise wrong(f"`{path}` is not a mesh that can be read", forms=listing(MESHES), hint="export it as one of these")


def picture(path: str, data: bytes) -> tuple[str, bytes]:
    """A texture for MuJoCo: its file's name, and its bytes.

    Raises:
        ArtifactError: A PNG has more than `MOST_TEXELS`.
    """
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        width, height = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
        bounds.check(path, "texels", width * height, MOST_TEXELS)
    return posixpath.basename(path), data


def _is_binary(data: bytes) -> bool:
    return len(data) >= 84 and len(data) >= 84 + 50 * int(np.frombuffer(data, "<u4", 1, 80)[0]) > 84


def _obj_of_text(path: str, data: bytes) -> bytes:
    """An ASCII STL as OBJ."""
    rows = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    try:
        points = np.array(rows, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError:
        points = np.zeros((0, 3, 3))
    if not len(points):
        raise wrong(
            f"`{path}` is not an STL",
            size=f"{len(data):,} bytes",
            hint="a pointer of Git LFS is replaced by `git lfs pull`",
        )
    return collada.obj(points.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))
