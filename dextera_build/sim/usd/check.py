"""Check a written USD folder with OpenUSD's validators."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.base import Folder


def problems(folder: Folder, scratch: Path) -> list[str]:
    """`validator: message (prim)` for every error and warning of `scene.usda`; empty if valid.

    Args:
        folder: The stage and its files.
        scratch: An existing scratch folder, because references are checked on disk.
    """
    from pxr import Usd, UsdValidation

    place = scratch / "usd"
    folder.export(place, "scene")
    stage = Usd.Stage.Open(str(place / "scene.usda"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    return sorted(f"{error.GetName()}: {error.GetMessage()} ({_sites(error)})" for error in found)


def _sites(error: object) -> str:
    sites = error.GetSites()  # type: ignore[attr-defined]
    return ", ".join(str(site.GetPrim().GetPath()) for site in sites if site.IsPrim()) or "stage"
