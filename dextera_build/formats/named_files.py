"""Files that a file names, such as textures and layers: next to it, and never outside the folder of the input."""

from __future__ import annotations

import os
from pathlib import Path


def found(name: str, beside: Path, folder: Path) -> Path:
    """The file that another one names.

    Args:
        name: Path relative to `beside`, or an absolute one; backslashes are treated as `/`.
        beside: The file that contains the name.
        folder: Folder of the whole input.

    Raises:
        ValueError: The file is missing, or outside of `folder`, by its path or through a link.
    """
    place = os.path.realpath(beside.parent / name.replace("\\", "/"))
    if not Path(place).is_relative_to(os.path.realpath(folder)):
        raise ValueError(f"`{name}`, which `{beside.name}` names, lies outside of the input")
    if not os.path.isfile(place):
        raise ValueError(f"`{name}`, which `{beside.name}` names, is missing")
    return Path(place)
