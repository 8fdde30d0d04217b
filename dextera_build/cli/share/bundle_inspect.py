"""`dxb bundle inspect`: what a bundle says of itself, without taking anything from it."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from dextera_build import digest
from dextera_build.bundle import importer, oci
from dextera_build.cli import options
from dextera_build.cli.share.bundle_import import judged, source_of
from dextera_build.errors import UsageError, did_you_mean, listing

if TYPE_CHECKING:
    from dextera_build.bundle.importer import Opened
    from dextera_build.bundle.trust import Voucher


def inspect(args: argparse.Namespace) -> int:
    """Print rows of name and value, or all as JSON, or one recipe."""
    project = options.project(args)
    bundle = importer.open_bundle(source_of(args.bundle))
    voucher = judged(args, project, bundle)
    if args.recipe:
        print(_recipe(bundle, args.recipe), end="")
    elif args.json:
        print(json.dumps(_everything(bundle, voucher), indent=1))
    else:
        print("".join(f"{name}\t{value}\n" for name, value in _rows(bundle, voucher)), end="")
    return 0


def _rows(bundle: Opened, voucher: Voucher) -> list[tuple[str, object]]:
    nodes = [node for _, node in bundle.contents.nodes()]
    layers = bundle.manifest.layers
    return [
        ("digest", f"sha256:{bundle.digest}"),
        ("created", bundle.manifest.annotations.get(oci.CREATED, "-")),
        *(("target", name) for name in bundle.contents.targets()),
        ("closure", bundle.contents.closure),
        ("nodes", len(nodes)),
        ("results", len({node.key for node in nodes if node.result})),
        ("with bytes", len({node.key for node in nodes if node.is_whole})),
        ("layers", len(layers)),
        ("bytes", bundle.size),
        *(
            ("recipe", f"{name}\tsha256:{digest.of_bytes(text.encode())}")
            for name, text in bundle.contents.recipes.items()
        ),
        ("made by", f"dxb {bundle.contents.dxb}"),
        ("inputs", len({path for node in nodes for path in node.files.values()})),
        ("signature", str(voucher)),
    ]


def _everything(bundle: Opened, voucher: Voucher) -> dict[str, Any]:
    return {
        "digest": f"sha256:{bundle.digest}",
        "bytes": bundle.size,
        "manifest": json.loads(bundle.manifest.spell()),
        "config": json.loads(bundle.contents.spell()),
        "signature": {"state": voucher.state, "signer": voucher.signer},
    }


def _recipe(bundle: Opened, name: str) -> str:
    known = bundle.contents.recipes
    if name not in known:
        raise UsageError(
            f"there is no recipe `{name}` in the bundle",
            code="DXB-U148",
            facts={"recipes": listing(known)},
            hint=did_you_mean(name, known),
        )
    return known[name]
