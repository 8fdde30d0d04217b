"""The grammar of the command line."""

from __future__ import annotations

import argparse
import importlib
from typing import NoReturn

from dextera_build import __version__
from dextera_build.cli.verbs import VERBS
from dextera_build.errors import UsageError, did_you_mean


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in the form of every other error."""

    def error(self, message: str) -> NoReturn:
        hint = f"`{self.prog} --help` shows what it takes"
        if message.startswith("argument VERB: invalid choice: "):
            wrong = message.split("'")[1]
            message, hint = f"there is no verb `{wrong}`", did_you_mean(wrong, VERBS, "`dxb {}`") or hint
        raise UsageError(message, code="DXB-U101", hint=hint)


def parser(verb: str | None = None) -> argparse.ArgumentParser:
    """The command line's grammar; with `verb`, only that verb's arguments are filled in, so that start-up is quick."""
    top = _Parser(prog="dxb", description="A content-addressed build system for robot digital twins.")
    top.add_argument("--version", action="version", version=f"dxb {__version__}")
    verbs = top.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)
    for name, summary in VERBS.items():
        sub = verbs.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
        if verb in (None, name):
            importlib.import_module(f"dextera_build.cli.{name}").arguments(sub)
    return top


def alone(verb: str) -> argparse.ArgumentParser:
    """What a verb takes."""
    found = _Parser(prog=f"dxb {verb}")
    importlib.import_module(f"dextera_build.cli.{verb}").arguments(found)
    return found
