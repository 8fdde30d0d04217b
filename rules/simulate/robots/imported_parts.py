"""Files of a robot as parts of a model, and verification of the assembled poses."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import did_you_mean, listing
from dextera_build.rule import Context

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.assembly import Frame, Placed

    from .imported_options import PartOptions

WORLD = "world"
"""Root that selects everything in an MJCF."""
TOLERANCE = 1e-6
"""Largest difference of a body's pose from its file's [m, rotation matrix entries]."""
SAMPLES = 3
"""Random postures in which poses are compared."""


def descriptions(files: Folder) -> list[str]:
    """Paths of the files that may describe a robot."""
    return sorted(path for path in files.files if posixpath.splitext(path)[1].lower() in (".urdf", ".xml", ".mjcf"))


def licences(files: Folder, parts: Iterable[PartOptions]) -> dict[str, bytes]:
    """`licences/<part>_<name>` -> text of the licence files next to a part's file or in a parent folder."""
    from dextera_build.sim.model.published import stated

    found: dict[str, bytes] = {}
    for number, each in enumerate(parts):
        folder = posixpath.dirname(posixpath.normpath(each.file))
        while True:
            here = {name: data for name, data in files.files.items() if posixpath.dirname(name) == folder}
            if own := stated({posixpath.basename(name): data for name, data in here.items()}):
                found |= {f"licences/{number}_{name}": data for name, data in own.items()}
                break
            if not folder:
                break
            folder = posixpath.dirname(folder)
    return found


def part(ctx: Context, files: Folder, options: PartOptions, number: int) -> Placed:
    """Read the file of a part.

    Args:
        ctx: Context for errors.
        files: All files.
        options: Options of the part.
        number: Number of the part; the first is mounted on the world.
    """
    from dextera_build.sim.model.imported import mjcf, roots, urdf
    from dextera_build.sim.model.imported.assembly import Placed
    from dextera_build.sim.model.imported.source import WHOLE

    path = posixpath.normpath(options.file)
    if path not in files.files:
        ctx.fail(
            f"there is no file `{options.file}`",
            here=listing(descriptions(files)) or listing(files.files),
            hint=did_you_mean(options.file, descriptions(files)),
        )
    begins = files.files[path][:4096]
    robot = b"<robot" in begins or path.endswith(".urdf")
    whole = options.root == WORLD
    source = urdf.read(path, files.files, options.repair_inertias) if robot else mjcf.read(path, files.files, whole)
    tops = [body.name for body in source.spec.worldbody.bodies]
    root = options.root if not whole else tops[0] if robot else WHOLE
    if root and source.spec.body(root) is None:
        bodies = [body.name for body in source.spec.bodies[1:]]
        ctx.fail(
            f"`{options.file}` has no link `{options.root}`",
            links=listing(bodies, most=60),
            hint=did_you_mean(options.root, bodies),
        )
    if not root and len(tops) != 1:
        ctx.fail(
            f"`{options.file}` has {len(tops)} root links",
            links=listing(tops),
            hint="name one as `root`, or `root: world` for all",
        )
    if bool(options.on) != bool(number):
        ctx.fail(
            f"part `{options.file}` is fixed on "
            + (f"`{options.on}`, but it is the first" if options.on else "nothing"),
            hint="name the arm's file first, and `on: LINK` for the hand",
        )
    meshes = [mesh.name for mesh in source.spec.meshes]
    for name in options.drawn:
        if name not in meshes:
            ctx.fail(f"`{options.file}` has no mesh `{name}`", meshes=listing(meshes, most=40))
    _fill(ctx, source.spec, options)
    root = root or tops[0]
    if not (number or options.prefix):
        source.renamed = roots.free_base(source.spec, root)
    return Placed(source, root, options.prefix, options.on, options.at_m, options.quaternion, options.drawn)


def _fill(ctx: Context, spec: Any, options: PartOptions) -> None:
    """Let everything that links of `solid` draw touch."""
    for name in options.solid:
        if (link := spec.body(name)) is None:
            bodies = [body.name for body in spec.bodies[1:]]
            ctx.fail(f"`{options.file}` has no link `{name}`", hint=did_you_mean(name, bodies) or "correct `solid`")
        for geom in link.geoms:
            geom.contype = geom.conaffinity = 1


def sites(parts: list[Placed]) -> dict[str, Frame]:
    """Name of a site, with prefix -> its frame."""
    from dextera_build.sim.model.imported.assembly import Frame

    found = {}
    for number, each in enumerate(parts):
        for site in each.source.spec.sites:
            link = "base" if number == 0 and site.parent.name == each.root else each.prefix + site.parent.name
            if site.name:
                turn = np.array(site.quat) / np.linalg.norm(site.quat)
                found[each.prefix + site.name] = Frame(link, list(site.pos), turn.tolist())
    return found


def check_names(ctx: Context, parts: list[Placed]) -> None:
    """Raise for names that occur in two parts, and for mounts on links that do not exist."""
    known: set[str] = set()
    for each, own in zip(parts, links(parts), strict=True):
        if each.parent and each.parent not in known:
            ctx.fail(
                f"`{each.parent}` carries a part, but no link of an earlier part is called so",
                links=listing(known, most=60),
                hint=did_you_mean(each.parent, known),
            )
        for name in own:
            if name in known:
                ctx.fail(f"two links are called `{name}`", hint="give the parts prefixes: `prefix: hand_`")
            known.add(name)
    joints = [part.prefix + joint.name for part in parts for joint in moving(part)]
    twice = sorted({name for name in joints if joints.count(name) > 1})
    if twice:
        ctx.fail(f"two joints are called `{twice[0]}`", hint="give the parts prefixes: `prefix: hand_`")


def links(parts: list[Placed]) -> list[list[str]]:
    """Names of the links of every part in the robot."""
    found = []
    for number, each in enumerate(parts):
        names = [each.prefix + body.name for body in below(each.source.spec.body(each.root))]
        found.append(["base", *names[1:]] if number == 0 else names)
    return found


def below(body: Any) -> list[Any]:
    """A body and all its descendants."""
    found = [body]
    for each in found:
        found += list(each.bodies)
    return found


def moving(part: Placed) -> list[Any]:
    """Joints of a part."""
    return [joint for body in below(part.source.spec.body(part.root)) for joint in body.joints]


class Places:
    """Poses of a file's bodies in its root, at any posture.

    Args:
        part: The description, before it becomes part of another model.
    """

    def __init__(self, part: Placed) -> None:
        from dextera_build.sim.model.imported.assembly import compiled

        self._model = compiled(part.source.spec)
        self.bodies = [body.name for body in below(part.source.spec.body(part.root))]
        self.joints = [joint.name for joint in moving(part)]
        self._root = part.root
        self.mass = sum(float(self._model.body(name).mass[0]) for name in self.bodies)
        """Mass of all its bodies [kg]."""

    def at(self, posture: Mapping[str, float]) -> np.ndarray:
        """(B, 3, 4) poses in the root at joint -> position."""
        return places(self._model, self._root, self.bodies, posture)


def places(model: Any, root: str, bodies: list[str], posture: Mapping[str, float]) -> np.ndarray:
    """(B, 3, 4) poses of bodies in the body `root` of a compiled model."""
    import mujoco

    data = mujoco.MjData(model)
    for name, position in posture.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    turn, origin = data.body(root).xmat.reshape(3, 3), data.body(root).xpos
    rows = [
        np.column_stack([turn.T @ data.body(name).xmat.reshape(3, 3), turn.T @ (data.body(name).xpos - origin)])
        for name in bodies
    ]
    return np.array(rows)


def check_places(
    ctx: Context, model: RobotModel, parts: list[Placed], wanted: list[Places], fixed: Mapping[str, float]
) -> float:
    """Raise for a model whose bodies have other poses than in the files; return the largest difference."""
    from dextera_build.sim.model import robot as robots

    whole = robots.load(model.model).compile()
    random = np.random.default_rng(0)
    worst = 0.0
    for _ in range(SAMPLES):
        posture = {joint.name: float(random.uniform(joint.lower, joint.upper)) for joint in model.joints}
        posture = model.followed(posture)
        for number, (each, known) in enumerate(zip(parts, wanted, strict=True)):
            own = {name: {**fixed, **posture}[each.prefix + name] for name in known.joints}
            names = [each.prefix + name for name in known.bodies]
            names[0] = "base" if number == 0 else names[0]
            found = places(whole, names[0], names, posture)
            worst = max(worst, float(np.abs(found - known.at(own)).max()))
    ctx.check(
        worst <= TOLERANCE,
        "links came out in another place than in the files",
        largest=f"{worst:.2g} m or rotation matrix entries",
        hint="report the file: nothing in a recipe can cause this",
    )
    return worst
