"""Judge a written USD folder by the validators that come with OpenUSD."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.base import Folder


def problems(folder: Folder, scratch: Path) -> list[str]:
    """`validator: message (prim)` for every error and warning of `scene.usda`; empty when it is valid.

    Args:
        folder: The stage and the files that it names.
        scratch: An existing folder to write it to, because references are checked on disk.
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
