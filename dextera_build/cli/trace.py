"""`dxb trace`."""

import argparse


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""


def run(args: argparse.Namespace) -> int:
    """To come."""
    return 0
