"""`dxb new robot`: a recipe for a robot's URDF or MJCF, with guessed roles, and copies of files from elsewhere."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from dextera_build.cli import options
from dextera_build.cli.project import robot_files, robot_text, written
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError
from dextera_build.project.project import Project
from dextera_build.report.wording import count


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "--repair-inertias",
        action="store_true",
        help="of a robot, replace moments of inertia that no body has by the nearest ones that a body can have",
    )


def run(args: argparse.Namespace) -> int:
    """Write the recipe and print its path."""
    if not args.name:
        raise UsageError("a robot takes its URDF or MJCF", code="DXB-U217", hint="`dxb new robot robots/arm/arm.urdf`")
    paths = [Path(each) for each in (args.name, args.object) if each]
    for each in paths:
        if not each.is_file():
            raise UsageError(f"there is no file `{each}`", code="DXB-U217", hint="name the robot's URDF or MJCF")
    project = options.project(args)
    own = project.root.absolute() / "recipes" / "robot"
    out = Path(args.out) if args.out else own / f"{'_with_'.join(_spelled(each.stem) for each in paths)}.yaml"
    name = _spelled(out.stem)
    if out.exists():
        raise UsageError(f"`{out}` exists already", code="DXB-U191", hint="`-o FILE` writes to another file")
    parts = [
        robot_files.read(each.resolve(), project, args.repair_inertias, attached=number > 0)
        for number, each in enumerate(paths)
    ]
    if not any(list(part.source.spec.joints) for part in parts):
        raise UsageError(
            f"`{paths[0].name}` has no joint: it is a tool, or a part of a robot",
            code="DXB-U217",
            hint="name the arm first: `dxb new robot ARM.xml TOOL.xml`",
        )
    folder, copied = robot_files.gathered(parts, project, name)
    text = robot_text.Text(name, folder, parts, args.repair_inertias)
    with writing(out):
        for path, data in copied.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text.recipe())
    print(project.shown(out.absolute()))
    for line in (*_told(project, name, out, copied), *text.told()):
        print(f"  {line}", file=sys.stderr)
    recipe, first = written.address(project, out, own / f"{name}.yaml")
    print(f"  {first}check every marked guess, then: dxb build {recipe}, dxb view {recipe}", file=sys.stderr)
    return 0


def _spelled(stem: str) -> str:
    """The name of a file as that of a robot."""
    return re.sub(r"[^a-z0-9]+", "_", stem.lower()).strip("_") or "robot"


def _told(project: Project, name: str, out: Path, copied: dict[Path, bytes]) -> Iterator[str]:
    """What was copied, and which recipe of dxb the new one hides."""
    if copied:
        size = sum(map(len, copied.values())) / 1e6
        place = project.shown(project.root / "robots" / name)
        yield f"copied {count(len(copied), 'file')} ({size:.1f} MB) to {place}"
    if out.absolute() == (project.root / "recipes" / "robot" / f"{name}.yaml").absolute():
        yield from written.hidden(project, f"robot/{name}")
