"""Check a written USD folder: with OpenUSD's validators, and against MuJoCo's model of the same scene."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.sim.model import attached, inventory
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.usd import packing, reader


def problems(folder: Folder, scratch: Path) -> list[str]:
    """`validator: message (prim)` for every error and warning of a folder's stage; empty if valid.

    Args:
        folder: The stage and its files.
        scratch: An existing scratch folder, because references are checked on disk.
    """
    from pxr import UsdValidation

    stage = opened(folder, scratch)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    return sorted(f"{error.GetName()}: {error.GetMessage()} ({_sites(error)})" for error in found)


def unequal(folder: Folder, description: SceneDescription, fixed: Collection[str], scratch: Path) -> list[str]:
    """Differences between the stage, read back, and MuJoCo's model of the scene, one line each; empty if equal.

    Compared are masses, inertias, joints with their drives, colliders, contact materials and filtered pairs; see
    `sim.model.inventory`.

    Args:
        folder: The stage and its files.
        description: The scene.
        fixed: Names of objects whose root cannot move.
        scratch: An existing scratch folder.
    """
    model = compile_folder(attached.write(description, fixed))
    return inventory.differences(inventory.of_model(model), reader.inventory(opened(folder, scratch)))


def opened(folder: Folder, scratch: Path) -> Any:
    """The stage of a folder, exported below `scratch`."""
    from pxr import Usd

    place = scratch / "usd"
    folder.export(place, "scene")
    return Usd.Stage.Open(str(place / packing.main(folder)))


def _sites(error: object) -> str:
    sites = error.GetSites()  # type: ignore[attr-defined]
    return ", ".join(str(site.GetPrim().GetPath()) for site in sites if site.IsPrim()) or "stage"
