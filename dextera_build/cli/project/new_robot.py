"""`dxb new robot`: a recipe for a robot's URDF or MJCF, with guessed roles."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError
from dextera_build.project.project import Project

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.source import Source

_HIGHEST = 3
"""Folders in which meshes are searched: the description's, its package's, and that of packages."""


def run(args: argparse.Namespace) -> int:
    """Write the recipe and print its path."""
    if not args.name or args.object:
        raise UsageError("a robot takes its URDF or MJCF", code="DXB-U217", hint="`dxb new robot robots/arm/arm.urdf`")
    file = Path(args.name)
    if not file.is_file():
        raise UsageError(f"there is no file `{file}`", code="DXB-U217", hint="name the robot's URDF or MJCF")
    project = options.project(args)
    name = re.sub(r"[^a-z0-9]+", "_", file.stem.lower()).strip("_") or "robot"
    out = Path(args.out) if args.out else project.root / "recipes" / "robot" / f"{name}.yaml"
    if out.exists():
        raise UsageError(f"`{out}` exists already", code="DXB-U191", hint="`-o FILE` writes to another file")
    folder, source, root = _read(file.resolve(), project)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(_text(project, name, file, folder, source, root))
    print(project.shown(out.absolute()))
    given = "" if _inside(project, folder) else f" --input files={folder}"
    print(f"  check every marked guess, then: dxb build robot/{name}{given}", file=sys.stderr)
    return 0


def _read(file: Path, project: Project) -> tuple[Path, Source, str]:
    """The folder that holds the file and its meshes, the parsed description, and the root link."""
    from dextera_build.errors import RuleError
    from dextera_build.sim.model.imported import mjcf, urdf

    wrong: RuleError | None = None
    robot = b"<robot" in file.read_bytes()[:4096] or file.suffix == ".urdf"
    folders = list(file.parents[:_HIGHEST])
    if _inside(project, file):
        folders = [folder for folder in folders if _inside(project, folder)]
    for folder in folders:
        path = str(file.relative_to(folder))
        files = _Lazy(folder)
        try:
            source = urdf.read(path, files) if robot else mjcf.read(path, files)
            roots = [body.name for body in source.spec.worldbody.bodies]
            if len(roots) > 1:
                return folder, mjcf.read(path, files, whole=True), mjcf.WHOLE
            return folder, source, roots[0]
        except RuleError as error:
            wrong = wrong or error
            if "missing" not in error.message:
                raise
    assert wrong is not None
    raise wrong


class _Lazy(dict[str, bytes]):
    """Path -> content of the files of a folder, read on demand."""

    def __init__(self, folder: Path) -> None:
        files = (each for each in folder.rglob("*") if each.is_file())
        super().__init__({str(each.relative_to(folder)): b"" for each in files})
        self._folder = folder

    def __getitem__(self, path: str) -> bytes:
        """The bytes of a file."""
        return (self._folder / path).read_bytes()


def _inside(project: Project, folder: Path) -> bool:
    return folder.is_relative_to(project.root.resolve())


def _text(project: Project, name: str, file: Path, folder: Path, source: Source, root: str) -> str:
    from dextera_build.sim.model.imported import guess, mjcf

    found = guess.roles(source, root)
    inside = _inside(project, folder)
    where = str(folder.relative_to(project.root.resolve())) if inside else "{help: The folder of the robot's files.}"
    part = str(file.resolve().relative_to(folder))
    lines = [
        f"summary: {file.name}, with roles that were guessed by `dxb new robot`.",
        "inputs:",
        f"  files: {where}",
        "nodes:",
        "  robot:",
        "    rule: simulate.imported_robot",
        "    files: $files",
        f"    name: {name}",
        f'    source: "{file.name}"',
        f"    parts: [{{file: {_quoted(part)}{', root: world' if root == mjcf.WHOLE else ''}}}]",
    ]
    if found.hand:
        lines += ["    # guess: the hand begins where the chain branches.", f"    hand: [{_list(found.hand)}]"]
    if found.frames:
        lines.append("    # guess: move a tip to the surface of its fingertip by `at_m`; the palm's z is its normal.")
        lines.append("    frames:")
        lines += [f"      {role}: {{link: {_quoted(link)}, at_m: [0, 0, 0]}}" for role, link in found.frames.items()]
    if found.gripper:
        joint, opened, closed = found.gripper
        lines.append("    # guess: where the gripper is open, and closed without an object [m].")
        gripper = f"{{joint: {_quoted(joint)}, open: {opened:g}, closed: {closed:g}}}"
        lines.append(f"    limbs: {{arm: {{gripper: {gripper}}}}}")
    lines += _numbers(source)
    return "\n".join([*lines, "targets:", "  default: [robot]", ""])


def _numbers(source: Source) -> list[str]:
    """Homes, and properties that the file does not state."""
    joints = {joint.name: joint for joint in source.spec.joints if joint.name not in source.mimics}
    lines = []
    if set(joints) - set(source.speeds):
        lines.append("    velocity_rad_s: 2.0  # guess: the file states no speed of some joints")
    if set(joints) - set(source.efforts):
        lines.append("    effort_nm: 10.0  # guess: the file states no torque of some joints")
    lines += ["    # guess: positions in which nothing touches [rad, of sliding joints m].", "    home_rad:"]
    lines += [f"      {_quoted(name)}: {_home(joint, source):.4g}" for name, joint in joints.items()]
    bare = [name for name, joint in joints.items() if float(joint.range[0]) >= float(joint.range[1])]
    if bare:
        lines += ["    # guess: the file states no limits of these joints.", "    joints:"]
        lines += [f"      {_quoted(name)}: {{lower_rad: -3.1416, upper_rad: 3.1416}}" for name in bare]
    return lines


def _home(joint: Any, source: Source) -> float:
    low, high = (float(each) for each in joint.range)
    value = source.home.get(joint.name, 0.0)
    return min(max(value, low), high) if low < high else value


def _list(names: list[str]) -> str:
    return ", ".join(map(_quoted, names))


def _quoted(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_./-]*", text) else '"' + text.replace('"', '\\"') + '"'
