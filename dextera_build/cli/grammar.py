"""The grammar of the command line."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator, Sequence
from typing import NoReturn

from dextera_build import __version__
from dextera_build.cli.verbs import GROUPS, MODULES, MOVED, VERBS
from dextera_build.errors import UsageError, did_you_mean, nearest

_FOOT = "`dxb help VERB`, `dxb help CODE` and `dxb help RULE` say more; verbs that print results take `--json`."


_INSTEAD = {("build", "--json"): "`dxb build --console jsonl` prints each event as JSON"}
"""Verb and flag that it lacks -> what to write."""


class _Parser(argparse.ArgumentParser):
    """A parser that raises `UsageError` for wrong arguments."""

    def error(self, message: str) -> NoReturn:
        hint: str | None = f"`{self.prog} --help` lists its arguments"
        if message.startswith("argument VERB: invalid choice: "):
            wrong = message.split("'")[1]
            message, hint = f"`{wrong}` is not a verb", did_you_mean(wrong, VERBS, "`dxb {}`") or hint
            if wrong in MOVED:
                message, hint = f"`dxb {wrong}` is now `dxb {MOVED[wrong]}`", None
        raise UsageError(message, code="DXB-U101", hint=hint)


class _Top(_Parser):
    """The parser of the whole command line."""

    def format_help(self) -> str:
        """List the verbs by group."""
        width = max(map(len, VERBS)) + 2
        lines = ["usage: dxb VERB [ARGUMENT ...]", "", str(self.description)]
        for group, verbs in GROUPS.items():
            lines += ["", f"{group}:", *(f"  {verb:<{width}}{text}" for verb, text in verbs.items())]
        return "\n".join([*lines, "", _FOOT, ""])


def parser(verb: str | None = None) -> argparse.ArgumentParser:
    """Build the command-line parser; with a `verb` that exists, add only that one, for a quick start-up."""
    top = _Top(prog="dxb", description="A content-addressed build system for robot digital twins.")
    top.add_argument("--version", action="version", version=f"dxb {__version__}")
    verbs = top.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for name, summary in VERBS.items():
        if verb == name or verb not in VERBS:
            sub = verbs.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
            if verb in (None, name):
                importlib.import_module(MODULES[name]).arguments(sub)
    return top


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Parse a command line, without `dxb`.

    Raises:
        UsageError: The arguments are wrong.
    """
    verb = next((word for word in words if not word.startswith("-")), "")
    top = parser(verb)
    args, rest = top.parse_known_args(words)
    if rest:
        known = sorted(set(_flags(top)))
        flag = next((word.partition("=")[0] for word in rest if word.startswith("-")), None)
        if flag is None:
            raise UsageError(f"`{rest[0]}` is an unexpected argument", code="DXB-U101", hint=f"`dxb {verb} --help`")
        names = {each.lstrip("-"): each for each in known}
        near = nearest(flag.lstrip("-"), names, 1, cutoff=0.6)
        hint = f"did you mean `{names[near[0]]}`?" if near else f"`dxb {verb} --help` lists its arguments"
        hint = _INSTEAD.get((verb, flag), hint)
        raise UsageError(f"`dxb {verb}` has no flag `{flag}`", code="DXB-U101", hint=hint)
    return args


def _flags(top: argparse.ArgumentParser) -> Iterator[str]:
    for action in top._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                yield from _flags(sub)
