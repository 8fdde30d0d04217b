"""`dxb bundle`: results with everything they refer to, as one file."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from dextera_build import __version__
from dextera_build.cli import options, table
from dextera_build.errors import UsageError, listing
from dextera_build.project.project import Project

_VERBS = {
    "create": "write results, with their provenance, to a file or folder",
    "inspect": "show the content, provenance and signatures of a bundle",
    "import": "take the results of a bundle into the store",
    "keygen": "make a pair of keys to sign bundles with",
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    verbs = parser.add_subparsers(dest="what", metavar="VERB", required=True)
    subs = {
        name: verbs.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        for name, text in _VERBS.items()
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
    """Run one of the verbs."""
    if args.what == "create":
        return _create(args)
    from dextera_build.cli.share import bundle_read

    return {"inspect": bundle_read.inspect, "import": bundle_read.take, "keygen": bundle_read.keygen}[args.what](args)


def _create(args: argparse.Namespace) -> int:
    """Write a bundle of targets from the store; print its path and digest."""
    from dextera_build.bundle import sign
    from dextera_build.bundle.closure_of_targets import survey
    from dextera_build.bundle.config import Build, Contents
    from dextera_build.bundle.export import Export
    from dextera_build.session import Session, addresses, reading

    project, added = options.project(args), options.added(args)
    builds, recipes, times = list[Build](), dict[str, str](), [0.0]
    for recipe, names in sorted(options.by_recipe(args.targets).items()):
        session = Session(project, recipe, added)
        plan = session.plan()
        asked = [address for name in names for address in addresses(plan.graph, name)]
        found = survey(plan.graph, asked, session.store, args.closure, partial(_shown, project))
        if found.stale:
            wanted = " ".join(f"{recipe}:{name}" if name else recipe for name in names)
            raise UsageError(
                f"the current version of `{recipe}` is not built",
                code="DXB-U142",
                facts={"stale": listing(found.stale)},
                hint=f"`dxb build {'--whole ' if args.closure == 'full' else ''}{wanted}`",
            )
        builds.append(Build(recipe, found.targets, project.profile, found.nodes))
        recipes |= _recipes(project, plan.recipes)
        past = ((session.past_builds.get(node.node), node) for node in found.nodes if node.node in found.targets)
        times += [entry.time for entry, node in past if entry is not None and entry.key == node.key]
    made = Export(reading(project), Contents(args.closure, __version__, tuple(builds), recipes), _created(max(times)))
    if args.sign:
        signature, key = sign.seal(made.digest, Path(args.sign))
        made.attach(signature)
        print(f"signed with {key.id}", file=sys.stderr)
    with table.writing(Path(args.out)):
        made.write(Path(args.out))
    told = {"file": args.out, "digest": f"sha256:{made.digest}"}
    return table.give("bundle.create", told, as_json=args.json)


def _recipes(project: Project, files: Sequence[Path]) -> dict[str, str]:
    """Address -> YAML of every recipe that planning read."""
    known = {path.resolve(): address for address, path in project.recipes()}
    return {known[path.resolve()]: path.read_bytes().decode() for path in files if path.resolve() in known}


def _created(newest: float) -> str:
    """Time of the newest target in this store, or `SOURCE_DATE_EPOCH` (https://reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if epoch and not epoch.isdigit():
        raise UsageError(f"`SOURCE_DATE_EPOCH` is a number of seconds, not `{epoch}`", code="DXB-U145")
    seconds = float(epoch or newest)
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds)) if seconds or epoch else ""


def _shown(project: Project, path: Path) -> str:
    """A path relative to the project's folder; outside it only the file name, because the full path is private."""
    return str(path.relative_to(project.root)) if path.is_relative_to(project.root) else path.name
