"""`target` and `setup` in `capture.json`: the calibration board and the mounting of the camera."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping
from typing import Literal

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.rule import Context

from ..facts import NAME
from . import fields

Mount = Literal["eye_on_base", "eye_in_hand"]
_SETUPS: Mapping[str, Mount] = {
    "eye-to-hand": "eye_on_base",
    "eye-on-base": "eye_on_base",
    "eye-in-hand": "eye_in_hand",
}
_ON_ROBOT = ("gripper", "hand", "effector", "flange", "robot")
_AROUND = ("table", "world", "room", "fixed", "floor", "wall")
_FAMILY = re.compile(r"(april(?:tag|grid)|aruco)[\s_-]*(.*)", re.IGNORECASE)
_CIRCLES = re.compile(r"(a(?:symmetric)?[\s_-]?)?circles?(?:[\s_-]?grid)?")
_APRILTAG = re.compile(r"(?:DICT_APRILTAG_|tag)?(\d\d)h(\d\d?)", re.IGNORECASE)


def mount_of(ctx: Context, facts: Mapping[str, object]) -> Mount:
    """Mounting of the camera, from `setup`."""
    setup = facts.get("setup")
    found = _SETUPS.get(setup.lower().replace("_", "-").replace(" ", "-")) if isinstance(setup, str) else None
    if found is None:
        ctx.fail(
            f"`{NAME}`: `setup` does not state where the camera is",
            found="nothing" if setup is None else reprlib.repr(setup),
            wanted='"eye-to-hand" for a camera next to the robot, "eye-in-hand" for one on its hand',
            hint=f'write `"setup": "eye-to-hand"` into `{NAME}`',
        )
    return found


def board_of(ctx: Context, facts: Mapping[str, object], mount: Mount) -> Board | None:
    """The calibration board in `target`; None if there is none."""
    target = facts.get("target")
    if target is None:
        return None
    if not isinstance(target, Mapping):
        fields.wrong(ctx, "target", target, 'an object: `{"type": "charuco", ...}`')
    _check_place(ctx, target, mount)
    kind = target.get("type")
    spelled = kind.strip().lower() if isinstance(kind, str) else ""
    if spelled in ("chessboard", "checkerboard"):
        columns, rows = _counts(ctx, target, "inner_corners", "of inner corners along x and y")
        return Board(kind="chessboard", columns=columns, rows=rows, square_m=_length(ctx, target, "square_m"))
    if spelled.startswith("charuco"):
        return _charuco(ctx, target)
    if (circles := _CIRCLES.fullmatch(spelled)) is not None:
        columns, rows = _counts(ctx, target, "circles", "of circles in one row, and of rows")
        kind = "asymmetric_circles" if circles[1] else "circles"
        return Board(kind=kind, columns=columns, rows=rows, square_m=_length(ctx, target, "spacing_m"))
    family = _FAMILY.match(kind) if isinstance(kind, str) else None
    if family is None:
        fields.wrong(
            ctx,
            "target.type",
            kind,
            '"chessboard", "charuco", "circles", "asymmetric circles", "aruco" or "AprilTag 36h11"',
        )
    return _markers(ctx, target, family[1].lower().startswith("april"), family[2])


def _charuco(ctx: Context, target: Mapping[str, object]) -> Board:
    columns, rows = _counts(ctx, target, "squares", "of squares along x and y")
    square, marker = _length(ctx, target, "square_m"), _length(ctx, target, "marker_m")
    if marker >= square:
        fields.wrong(ctx, "target.marker_m", marker, f"less than `square_m`, {square:g}")
    dictionary = target.get("dictionary")
    if not isinstance(dictionary, str):
        fields.wrong(ctx, "target.dictionary", dictionary, 'a family of markers, `"DICT_5X5_100"`')
    return Board(
        kind="charuco",
        columns=columns,
        rows=rows,
        square_m=square,
        marker_m=marker,
        dictionary=_dictionary(ctx, dictionary, april=False),
    )


def _markers(ctx: Context, target: Mapping[str, object], april: bool, family: str) -> Board:
    named = target.get("dictionary", family)
    if not isinstance(named, str) or not named:
        fields.wrong(ctx, "target.dictionary", named, '`"36h11"`' if april else '`"DICT_5X5_100"`')
    columns, rows = _counts(ctx, target, "markers", "of markers along x and y") if "markers" in target else (1, 1)
    side = _length(ctx, target, "size_m")
    gap = _length(ctx, target, "gap_m") if columns * rows > 1 else 0.0
    return Board(
        kind="apriltag" if april else "aruco",
        columns=columns,
        rows=rows,
        square_m=side + gap,
        marker_m=side if gap else 0.0,
        dictionary=_dictionary(ctx, named, april=april),
    )


def _dictionary(ctx: Context, name: str, *, april: bool) -> str:
    """A family in the spelling of `Board`: `DICT_5X5_100`, `36h11`."""
    found = _APRILTAG.fullmatch(name.strip())
    if found:
        short = f"{found[1]}h{found[2]}"
        return short if april else f"DICT_APRILTAG_{short}"
    spelled = name.strip().upper()
    if april:
        fields.wrong(ctx, "target.dictionary", name, 'a family of AprilTags: `"36h11"`')
    if not re.fullmatch(r"DICT_(\dX\d_\d+|ARUCO_\w+)", spelled):
        fields.wrong(ctx, "target.dictionary", name, 'a dictionary of OpenCV: `"DICT_5X5_100"`')
    return spelled


def _check_place(ctx: Context, target: Mapping[str, object], mount: Mount) -> None:
    """Raise for a board that moves with the camera, or a static board in front of a static camera."""
    mounted = target.get("mounted")
    if mounted is None:
        return
    if mounted not in _ON_ROBOT + _AROUND:
        fields.wrong(ctx, "target.mounted", mounted, '"gripper" for a board on the robot, "table" for one next to it')
    if (mounted in _ON_ROBOT) != (mount == "eye_on_base"):
        ctx.fail(
            f"`{NAME}`: the board never moves in the picture",
            setup=_setup(mount),
            mounted=mounted,
            hint='"eye-to-hand" needs a board on the gripper, "eye-in-hand" one on the table',
        )


def _setup(mount: Mount) -> str:
    """`setup` of a mount."""
    return next(word for word, each in _SETUPS.items() if each == mount)


def _length(ctx: Context, target: Mapping[str, object], key: str) -> float:
    value = fields.number(target.get(key))
    if value is None or value <= 0:
        fields.wrong(ctx, f"target.{key}", target.get(key), "a positive number of metres")
    if value > fields.LARGEST_BOARD_M:
        fields.wrong(ctx, f"target.{key}", value, "metres, below 2: divide millimetres by 1000")
    return value


def _counts(ctx: Context, target: Mapping[str, object], key: str, what: str) -> tuple[int, int]:
    value = target.get(key)
    whole = isinstance(value, list) and len(value) == 2 and all(type(each) is int and each > 0 for each in value)
    if not whole:
        fields.wrong(ctx, f"target.{key}", value, f"two whole numbers {what}")
    assert isinstance(value, list)
    return value[0], value[1]
