"""The name `base`, which the root of a robot model has, given up by other links of a file."""

from __future__ import annotations

from typing import Any

BASE = "base"
"""Name of the root of a robot model."""


def free_base(spec: Any, root: str) -> dict[str, str]:
    """Rename a link below `root` that is called `base`, in place; its old name -> the new one."""
    if root == BASE or not any(body.name == BASE for body in spec.bodies):
        return {}
    taken, name = {body.name for body in spec.bodies}, "base_frame"
    while name in taken:
        name += "_"
    spec.body(BASE).name = name
    return {BASE: name}
