"""`dxb bundle`: results with everything they refer to, as one file."""

from __future__ import annotations

import argparse
import importlib

from dextera_build.cli import options

_VERBS = {
    "create": ("bundle_make", "write results, with their provenance, to a file or folder"),
    "inspect": ("bundle_read", "show the content, provenance and signatures of a bundle"),
    "import": ("bundle_read", "take the results of a bundle into the store"),
    "keygen": ("bundle_read", "make a pair of keys to sign bundles with"),
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    verbs = parser.add_subparsers(dest="what", metavar="VERB", required=True)
    subs = {
        name: verbs.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        for name, (_, text) in _VERBS.items()
    }
    subs["create"].add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="targets that were built")
    subs["create"].add_argument("-o", "--out", metavar="FILE", required=True, help="NAME.tar")
    subs["create"].add_argument(
        "--closure",
        choices=("targets", "full"),
        default="targets",
        help="targets: bytes of the targets, all other results without bytes; full: bytes of all nodes",
    )
    subs["create"].add_argument("--sign", metavar="KEY", help="sign with this private ed25519 key (PEM or OpenSSH)")
    options.request_arguments(subs["create"])
    for name in ("inspect", "import"):
        subs[name].add_argument("bundle", metavar="BUNDLE", help="a bundle: FILE.tar")
        subs[name].add_argument(
            "--require-signed", action="store_true", help="refuse bundles that no trusted key signed"
        )
    subs["inspect"].add_argument("--recipe", metavar="NAME", help="print the YAML of this recipe of the bundle")
    subs["keygen"].add_argument("file", metavar="FILE", help="the private key; the public one goes to FILE.pub")
    subs["keygen"].add_argument("--name", metavar="NAME", help="name of the owner (user@host)")
    for name, sub in subs.items():
        if name != "keygen":
            options.project_arguments(sub)
        options.json_argument(sub)


def run(args: argparse.Namespace) -> int:
    """Carry out one of the verbs."""
    name, _ = _VERBS[args.what]
    module = importlib.import_module(f"dextera_build.cli.share.{name}")
    code: int = getattr(module, args.what.replace("import", "take"))(args)
    return code
