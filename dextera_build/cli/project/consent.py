"""`dxb consent`: which data of a project may be sent to which services."""

from __future__ import annotations

import argparse
import sys

from dextera_build.calls.question import PHOTOGRAPH
from dextera_build.cli import options, table
from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.project.project import Project
from dextera_build.project.terms import consents

_ACTIONS = {
    "ls": "list consents: service, kind of data, project, date",
    "give": "agree that data of this project are sent to a service",
    "withdraw": "take consent back; nothing more is sent",
}
_KINDS = (PHOTOGRAPH, "mesh")
"""Kinds of data as rules name them; a rule may name others."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    actions = parser.add_subparsers(dest="what", metavar="ACTION", required=True)
    subs = {}
    for name, text in _ACTIONS.items():
        subs[name] = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    for name in ("give", "withdraw"):
        subs[name].add_argument("service", metavar="SERVICE", help="its name, as in errors and `dxb ls calls`")
        subs[name].add_argument("kinds", nargs="*", metavar="KIND", help=f"kind of data: {PHOTOGRAPH}, mesh, ...")
    subs["give"].add_argument("--everywhere", action="store_true", help="in all projects")
    for sub in subs.values():
        options.project_arguments(sub)
    options.json_argument(subs["ls"])


def run(args: argparse.Namespace) -> int:
    """Run the action."""
    project = options.project(args)
    return {"ls": _list, "give": _give, "withdraw": _withdraw}[args.what](project, args)


def _list(project: Project, args: argparse.Namespace) -> int:
    """Print one line per consent, first those of the variable `DXB_CONSENT`; `*` means every service."""
    found = consents(project)
    rows = [{"service": s, "data": kind, "project": "DXB_CONSENT", "given": None} for s, kind in found.of_variable()]
    return table.give("consent.ls", [*rows, *(vars(one) for one in found.all())], as_json=args.json)


def _give(project: Project, args: argparse.Namespace) -> int:
    kinds = args.kinds or [PHOTOGRAPH]
    for kind in kinds:
        if kind not in _KINDS and (near := did_you_mean(kind, _KINDS)):  # rules may name kinds of their own
            raise UsageError(f"no data are of the kind `{kind}`", code="DXB-U181", hint=near)
    consents(project).give(args.service, kinds, everywhere=args.everywhere)
    where = "every project" if args.everywhere else "this project"
    print(f"`{args.service}` may receive from {where}: {listing(kinds)}", file=sys.stderr)
    return 0


def _withdraw(project: Project, args: argparse.Namespace) -> int:
    found = consents(project)
    if not found.withdraw(args.service, args.kinds):
        raise UsageError(
            f"there is no such consent for `{args.service}`",
            code="DXB-U182",
            facts={"services with consent": listing({one.service for one in found.all()})},
            hint="`dxb consent ls` lists all of them",
        )
    print(f"withdrawn; data that `{args.service}` has received stay there", file=sys.stderr)
    return 0
