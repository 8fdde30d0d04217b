"""`dxb completion`: a script for the shell that completes verbs, flags, recipes, nodes, rules and runs."""

from __future__ import annotations

import argparse


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell to complete in")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["dxb"], shell=args.shell))
    return 0
