"""`dxb completion`: a script for the shell that completes verbs, flags, recipes, nodes, rules and runs."""

from __future__ import annotations

import argparse

from dextera_build.errors import UsageError, listing

_SHELLS = ("bash", "zsh", "fish")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("shell", metavar="SHELL", help=listing(_SHELLS))


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    if args.shell not in _SHELLS:
        raise UsageError(
            f"`{args.shell}` is not a shell that dxb completes for",
            code="DXB-U175",
            facts={"shells": listing(_SHELLS)},
        )
    from argcomplete.shell_integration import shellcode

    print(shellcode(["dxb"], shell=args.shell))
    return 0
