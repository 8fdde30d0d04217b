"""`dxb library`: the objects and backgrounds that this project built: a list, a search, a folder with a gallery."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options, table
from dextera_build.errors import UsageError

if TYPE_CHECKING:
    from dextera_build.explain.asset import Asset


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "sought",
        nargs="*",
        metavar="WORD",
        help="words that an asset must have in its name, category, material, joints or node: mug ceramic, revolute",
    )
    parser.add_argument("--kind", choices=("object", "background"), help="only objects, or only backgrounds")
    parser.add_argument("--all", action="store_true", help="also assets that a later build of the same node replaced")
    parser.add_argument(
        "-o", "--out", metavar="DIR", help="write index.json, the gallery index.html and the assets' files to a folder"
    )
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one row per asset, or write the folder and print the paths of its index and its page."""
    from dextera_build.explain import library

    project = options.project(args)
    words = [word.lower() for word in args.sought]
    found = [
        asset
        for asset in library.assets(project, old=args.all)
        if (not args.kind or asset.kind == args.kind) and all(word in asset.words() for word in words)
    ]
    if args.out is None:
        rows = [_row(asset) for asset in found]
        none = "no asset fits" if words or args.kind else "no asset was built here"
        return table.give("library", rows, as_json=args.json, cells=[_cells(one) for one in found], none=none)
    if not found:
        raise UsageError(
            "no asset fits" if words or args.kind else "no asset is in the store",
            code="DXB-U218",
            hint="`dxb library` lists all; `dxb build twin/laptop_scene` makes some",
        )
    from dextera_build.building import library as folder

    out = Path(args.out)
    with table.writing(out):
        written = [project.shown(path.absolute()) for path in folder.write(project, found, out)]
    table.say("library.folder", {"files": written}, "\n".join(written), as_json=args.json)
    return 0


def _row(asset: Asset) -> dict[str, Any]:
    """The asset as data, with None for texts that do not apply."""
    plain = asset.plain()
    return plain | {name: plain[name] or None for name in ("scale", "material", "urdf")}


def _cells(asset: Asset) -> dict[str, str]:
    size = "-" if asset.size_m is None else "x".join(f"{1000 * edge:.0f}" for edge in asset.size_m)
    return {
        "kind": asset.kind,
        "name": asset.name,
        "category": asset.category,
        "size_mm": size,
        "mass_kg": "-" if asset.mass_kg is None else f"{asset.mass_kg:.3f}",
        "joints": ",".join(joint.type for joint in asset.joints) or "-",
        "source": asset.source,
        "digest": asset.digest[:12],
        "node": asset.nodes[0] + (f" and {len(asset.nodes) - 1} more" if len(asset.nodes) > 1 else ""),
    }
