"""`dxb new`: a recipe, rule, backend, capture, robot, twin or tasks to start from; a photograph's objects; a board."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from dextera_build.cli import options
from dextera_build.cli.project import (
    new_backend,
    new_board,
    new_capture,
    new_robot,
    new_seen,
    new_task,
    new_twin,
    written,
)
from dextera_build.cli.table import writing
from dextera_build.errors import RecipeError, UsageError
from dextera_build.project.project import Project

_RECIPE = """summary: What this builds, in one line.
inputs:
  capture:
    help: A folder with rgb.png, depth.png and capture.json.
nodes:
  photo: {rule: capture.folder, folder: $capture}
targets:
  default: [photo]
"""
_RULE = '''"""{path}: what it does, in one line."""

from __future__ import annotations

from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, Options, rule


class {kind}Options(Options):
    """Options of {path}. Every field enters the key."""

    gain: float = 1.0
    """Factor on the brightness."""


@rule(version=1, packages=("numpy",))
def {name}(ctx: Context, image: Image, *, options: {kind}Options) -> Image:
    """Return `image` with its brightness multiplied by `gain`."""
    bright = (image.pixels * options.gain).clip(0, 255).astype("uint8")
    ctx.preview(bright)
    ctx.say(f"gain {{options.gain:g}}")
    return Image(pixels=bright)
'''


_NAMES = {
    "recipe": (r"[a-z0-9_]+(/[a-z0-9_]+)+", "twin/my_scene"),
    "rule": (r"[a-z0-9_]+\.[a-z0-9_]+", "factorize.my_rule"),
    "backend": (r"[a-z0-9_]+\.[a-z0-9_]+=[a-z0-9_]+", "factorize.my_rule=my_backend"),
}
"""Kind -> the pattern of its names, and an example."""
_MADE = {
    "board": new_board.run,
    "capture": new_capture.run,
    "robot": new_robot.run,
    "task": new_task.run,
    "twin": new_twin.run,
}
"""Kind -> writes its files."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("kind", choices=(*_NAMES, *new_seen.KINDS, *_MADE), help="kind of file")
    parser.add_argument(
        "--kind",
        dest="backend_kind",
        choices=new_backend.KINDS,
        help="how a backend works: in dxb's process, by a service, by a program per call, or by one that stays",
    )
    parser.add_argument(
        "name",
        nargs="?",
        help="twin/my_scene, factorize.my_rule, or factorize.my_rule=my_backend; of a scene or a mask, the recipe of "
        "its photograph; of tasks, the recipe of their twin; of a capture, its folder; of a robot, its URDF or MJCF; "
        "of a board, its pattern (charuco)",
    )
    parser.add_argument(
        "object",
        nargs="?",
        help="of a mask, the object: blue_mug; of tasks, the robot: robot/kuka_leap; of a robot, the URDF or MJCF of "
        "the hand on its flange",
    )
    parser.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        help="of a scene (scene.yaml), a mask (masks/OBJECT.png), a board, a robot, a twin or tasks",
    )
    new_board.arguments(parser)
    new_robot.arguments(parser)
    new_twin.arguments(parser)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Write the files and print their paths."""
    made = _made_elsewhere(args)
    if made is not None:
        return made(args)
    form, example = _NAMES[args.kind]
    if not re.fullmatch(form, args.name):
        raise UsageError(f"`{args.name}` is not a valid name; one looks like `{example}`", code="DXB-U192")
    project = options.project(args)
    files, note = _files(project, args.kind, args.name, args.backend_kind)
    for path in files:
        if path.exists():
            raise UsageError(f"`{path}` exists already", code="DXB-U191")
    hidden = _hidden(project, args.kind, args.name)
    for path, text in files.items():
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        print(project.shown(path))
    for line in hidden:
        print(f"  {line}", file=sys.stderr)
    if note:
        print(f"note: {note}", file=sys.stderr)
    print(f"  {_next(args.kind, args.name)}", file=sys.stderr)
    return 0


def _next(kind: str, name: str) -> str:
    """What to do with a new file."""
    if kind == "recipe":
        return f"edit it, then: dxb check {name}, dxb build {name} --input capture=FOLDER"
    if kind == "rule":
        return f"edit it, then use it in a recipe: `NODE: {{rule: {name}, image: $...}}`; dxb show {name}"
    return f"edit it, then: dxb build RECIPE --backend {name}"


def _hidden(project: Project, kind: str, name: str) -> list[str]:
    """Lines about the rule or recipe from elsewhere whose place one of this name takes."""
    if kind == "recipe":
        return written.hidden(project, name)
    with suppress(RecipeError):
        there = project.shown(project.library.find(name).file) if kind == "rule" else ""
        return [f"warning: {name} of this project now takes the place of the rule in {there}"] if there else []
    return []


def _made_elsewhere(args: argparse.Namespace) -> Callable[[argparse.Namespace], int] | None:
    """The function that writes files of this kind, if it is none of `_NAMES`; wrong arguments are refused."""
    if args.kind != "board" and new_board.given(args):
        raise UsageError(
            f"a {args.kind} has no paper and no squares", code="DXB-U217", hint="only `dxb new board` takes them"
        )
    if args.kind != "robot" and args.repair_inertias:
        raise UsageError(
            f"a {args.kind} has no inertias", code="DXB-U217", hint="only `dxb new robot` takes `--repair-inertias`"
        )
    if args.kind != "twin" and args.moved_camera:
        raise UsageError(f"a {args.kind} has no camera that moved", code="DXB-U217", hint="`dxb new twin` takes it")
    if args.kind in _MADE:
        return _MADE[args.kind]
    if not args.name:
        raise UsageError(f"a {args.kind} takes a name", code="DXB-U192", hint=f"`dxb new {args.kind} NAME`")
    if args.kind in new_seen.KINDS:
        return new_seen.run
    if args.object or args.out or options.added(args):
        joined = args.kind == "backend" and args.object and "=" not in args.name
        wanted = f"{args.name}={args.object}" if joined else args.name
        raise UsageError(
            f"a {args.kind} takes its name and nothing else",
            code="DXB-U215",
            hint=f"`dxb new {args.kind} {wanted}`; `-o`, an object and changes to a recipe are for scenes and masks",
        )
    return None


def _files(project: Project, kind: str, named: str, backend_kind: str | None) -> tuple[dict[Path, str], str]:
    """Path -> text of each file, and the missing parts."""
    if backend_kind is not None and kind != "backend":
        raise UsageError(f"a {kind} has no kind", code="DXB-U197", hint=f"`dxb new {kind} {named}`")
    if kind == "recipe":
        return {project.root / "recipes" / f"{named}.yaml": _RECIPE}, ""
    path, _, backend = named.partition("=")
    stage, _, name = path.partition(".")
    if kind == "rule":
        camel = "".join(part.capitalize() for part in name.split("_"))
        return {project.root / "rules" / stage / f"{name}.py": _RULE.format(path=path, name=name, kind=camel)}, ""
    found = project.library.find(path)
    own = found.file.is_relative_to((project.root / "rules").absolute())
    # A backend of a rule from elsewhere lies in the same stage of the project.
    folder = found.file.parent if own else project.root / "rules" / stage
    file = folder / f"{found.file.stem}_{backend}.py"
    wanted = new_backend.Wanted(found, backend, backend_kind or "in-process", file, project.shown(file), own)
    return new_backend.files(wanted, project.root / "tests"), new_backend.note(wanted)
