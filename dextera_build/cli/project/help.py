"""`dxb help`: a verb, an error code, a rule, or an artifact type."""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap

from dextera_build.cli.verbs import MOVED, VERBS
from dextera_build.errors import UsageError, did_you_mean

_INDENT = "   "
_WIDEST = 100
"""Longest line of an explanation [characters]."""
_CODE = re.compile(r"(?:DXB-)?([A-Z]\d{3})", re.IGNORECASE)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "what", nargs="?", metavar="VERB|CODE|RULE|TYPE", help="`why`, `DXB-R104`, `factorize.mesh` or `Mesh`"
    )


def run(args: argparse.Namespace) -> int:
    """Print the help of a verb, an error code, a rule or a type; without an argument, the overview."""
    from dextera_build.cli.grammar import parser

    what = args.what
    if what is None:
        print(parser("").format_help(), end="")
    elif what in VERBS or what in MOVED:
        words = MOVED.get(what, what).split()
        parser(words[0]).parse_args([*(word for word in words if not word.startswith("-")), "--help"])
    elif code := _CODE.fullmatch(what):
        print(_meaning(f"DXB-{code[1].upper()}"))
    elif what[0].isupper():
        _type(what)
    else:
        return _rule(what)
    return 0


def _meaning(code: str) -> str:
    from dextera_build.explain import error_codes

    found = list(dict.fromkeys(error_codes.sites(code)))
    if not found:
        hint = "codes are `DXB-`, a letter and three digits, as in `DXB-R104`"
        raise UsageError(f"there is no error `{code}`", code="DXB-U196", hint=hint)
    kind = error_codes.family(code[4])
    room = min(shutil.get_terminal_size((_WIDEST, 24)).columns, _WIDEST) - 1
    lines = textwrap.wrap(f"{code}: {(kind.__doc__ or '').partition(chr(10))[0]}", room)
    about = error_codes.section(code)
    for part in about:
        lines += ["", *(_example(part, room) if part.startswith("```") else textwrap.wrap(part, room))]
    for error in found if not about else ():
        lines += ["", error.message]
        lines += [f"   facts: {', '.join(error.facts)}"] if error.facts else []
        lines += [f"   what to do: {error.hint}"] if error.hint else []
    return "\n".join(lines)


def _example(block: str, room: int) -> list[str]:
    """The lines of an example, indented; a remark that does not fit stands above its line."""
    lines = list[str]()
    for line in block.splitlines()[1:-1]:
        text, mark, remark = line.partition("  # ")
        fits = len(line) <= room - len(_INDENT) or not mark
        above = textwrap.wrap(remark, room - len(_INDENT), initial_indent="# ", subsequent_indent="# ")
        lines += [line] if fits else [*above, text.rstrip()]
    return [f"{_INDENT}{line}".rstrip() for line in lines]


def _rule(name: str) -> int:
    from dextera_build.cli import table
    from dextera_build.code.renamed import renamed
    from dextera_build.explain import rule_card
    from dextera_build.project import project

    library = project.find().library
    rules = {found.path: found for found in library.rules()}
    if name not in rules:
        raise renamed(name, None) or UsageError(
            f"`{name}` is neither a verb, an error code, a rule nor a type",
            code="DXB-U196",
            hint=did_you_mean(name, [*VERBS, *rules], "`dxb help {}`") or "`dxb ls rules` lists rules",
        )
    card = rule_card.rows(library, rules[name])
    table.show(card, rule_card.narrow(card))
    return 0


def _type(name: str) -> None:
    from dextera_build.cli import table
    from dextera_build.explain import type_card

    types = type_card.named()
    if name not in types:
        hint = did_you_mean(name, types, "`dxb help {}`") or "`dxb help RULE` names the types of a rule"
        raise UsageError(f"there is no artifact type `{name}`", code="DXB-U199", hint=hint)
    table.show(type_card.rows(types[name]))
