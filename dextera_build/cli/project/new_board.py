"""`dxb new board`: a calibration board as PDF at true size."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.cli.table import writing
from dextera_build.errors import UsageError

if TYPE_CHECKING:
    from dextera_build.artifacts.cameras.calibration import Board

PATTERNS = ("charuco", "chessboard", "aruco", "apriltag")
_COUNTS = {"charuco": (7, 5), "chessboard": (9, 6), "aruco": (1, 1), "apriltag": (1, 1)}
"""Pattern -> columns and rows; two sides that differ leave no doubt which way is up."""
_FAMILIES = {"charuco": "DICT_5X5_100", "aruco": "DICT_4X4_50", "apriltag": "36h11", "chessboard": ""}
MARKER, GAP = 0.75, 0.25
"""Sides of a marker in its ChArUco square, and of a gap next to a marker."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a board."""
    group = parser.add_argument_group("a board")
    group.add_argument("--paper", choices=("a4", "a3", "letter"), default=None, help="sheet of paper (a4)")
    group.add_argument("--columns", type=int, help="squares across, inner corners of a chessboard, or markers")
    group.add_argument("--rows", type=int, help="the same down")
    group.add_argument("--square", type=float, metavar="MM", help="side of a square, or of a marker; else the largest")
    group.add_argument("--marker", type=float, metavar="MM", help="side of a ChArUco board's markers")
    group.add_argument("--gap", type=float, metavar="MM", help="gap between the markers of a grid")
    group.add_argument("--dictionary", help="family of the markers: DICT_5X5_100, 36h11")


def given(args: argparse.Namespace) -> bool:
    """Whether any argument of a board was given."""
    names = ("paper", "columns", "rows", "square", "marker", "gap", "dictionary")
    return any(getattr(args, name) is not None for name in names)


def run(args: argparse.Namespace) -> int:
    """Write the sheet, and print its path and its part of `capture.json`."""
    from dextera_build.formats import board_sheet

    pattern = args.name or "charuco"
    if pattern not in PATTERNS or args.object:
        raise UsageError(
            f"`{args.object or pattern}` is not a board",
            code="DXB-U217",
            facts={"boards": ", ".join(PATTERNS)},
            hint="`dxb new board charuco`",
        )
    paper = args.paper or "a4"
    board = _board(args, pattern, paper)
    data = board_sheet.pdf(board, paper)
    out = Path(args.out or "board.pdf")
    if out.exists():
        raise UsageError(f"`{out}` exists already", code="DXB-U191", hint="`-o FILE` writes to another file")
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    print(out)
    print(
        f'  print it at 100 %, measure its bar, then write: "target": {json.dumps(board_sheet.target(board))}',
        file=sys.stderr,
    )
    return 0


def _board(args: argparse.Namespace, pattern: str, paper: str) -> Board:
    from dextera_build.artifacts.cameras.calibration import Board

    usual = _COUNTS[pattern]
    columns = usual[0] if args.columns is None else args.columns
    rows = usual[1] if args.rows is None else args.rows
    numbers = [value for value in (columns, rows, args.square, args.marker, args.gap) if value is not None]
    if min(numbers) < 0 or min(columns, rows) < 1 or args.square == 0:
        raise UsageError("a board has positive counts and sides", code="DXB-U217", hint="`dxb new board --square 30`")
    side_mm = args.square or _largest(pattern, columns, rows, paper, args.gap)
    square, marker = side_mm / 1000, 0.0
    if pattern == "charuco":
        marker = (args.marker or math.floor(MARKER * side_mm)) / 1000
        if marker >= square:
            raise UsageError(
                "a marker is smaller than its square", code="DXB-U217", hint=f"`--marker {MARKER * side_mm:g}`"
            )
    elif pattern != "chessboard" and columns * rows > 1:
        gap_mm = args.gap if args.gap is not None else round(GAP * side_mm, 1)
        square, marker = (side_mm + gap_mm) / 1000, square
    return Board(
        kind=pattern,
        columns=columns,
        rows=rows,
        square_m=round(square, 6),
        marker_m=round(marker, 6),
        dictionary=args.dictionary or _FAMILIES[pattern],
    )


def _largest(pattern: str, columns: int, rows: int, paper: str, gap: float | None) -> int:
    """Side of the largest square or marker of whole millimetres that fits."""
    from dextera_build.formats.board_sheet import EDGE_MM, FOOT_MM, QUIET
    from dextera_build.formats.pdf import PAPERS_MM

    extra = {"chessboard": 1.0 + QUIET, "charuco": 0.0}.get(pattern, QUIET)
    found = 0.0
    for sheet in (PAPERS_MM[paper], PAPERS_MM[paper][::-1]):
        room = (sheet[0] - 2 * EDGE_MM, sheet[1] - FOOT_MM - 2 * EDGE_MM)
        sides = []
        for length, count in zip(room, (columns, rows), strict=True):
            if pattern in ("aruco", "apriltag"):
                fixed = 0.0 if gap is None else gap * (count - 1)
                sides.append((length - fixed) / (count + extra + (GAP * (count - 1) if gap is None else 0.0)))
            else:
                sides.append(length / (count + extra))
        found = max(found, min(sides))
    if found < 1:
        raise UsageError(
            "not even squares of 1 mm fit", code="DXB-U217", hint="fewer columns and rows, or larger paper"
        )
    return math.floor(found)
