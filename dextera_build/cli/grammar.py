"""The verbs of `dxb`, and the grammar of its command line."""

from __future__ import annotations

import argparse
import importlib
from typing import NoReturn

from dextera_build import __version__
from dextera_build.errors import UsageError, did_you_mean

VERBS = {
    "build": "build targets; only what is stale runs",
    "plan": "show what a build would do, without doing it",
    "watch": "build, and again whenever something that the build read changes",
    "get": "write a node's artifact to files",
    "why": "explain why a node is stale, or when it was built",
    "ls": "list recipes, rules, backends, nodes or runs",
    "show": "show an artifact, a node, or the configuration",
    "diff": "show what is different between two runs, nodes or artifacts",
    "log": "show past runs and what their nodes printed",
    "view": "look at a scene in the browser",
    "report": "write a run's report, one offline HTML file",
    "graph": "draw a recipe's graph as SVG, JSON or DOT",
    "trace": "write when every node of a run worked, for a trace viewer",
    "init": "make a new project",
    "new": "make a new recipe, rule or backend in this project",
    "check": "check recipes, or rebuild a node and compare",
    "doctor": "say what this machine has and lacks",
    "push": "upload what was built to a remote",
    "pull": "bring targets from a remote, without running anything",
    "cache": "look after the store",
    "bundle": "carry results elsewhere, with all that explains them",
    "completion": "print a script that completes command lines in bash, zsh or fish",
}


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
