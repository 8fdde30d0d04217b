"""Third-party MJCF as a source of robots: its bodies, joints, meshes and actuators."""

from __future__ import annotations

import posixpath
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dextera_build.sim.model.imported import files as meshes
from dextera_build.sim.model.imported import flat
from dextera_build.sim.model.imported.files import wrong
from dextera_build.sim.model.imported.precise import precise
from dextera_build.sim.model.imported.source import WHOLE, Source

_MOVING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def read(path: str, files: Mapping[str, bytes], whole: bool = False) -> Source:
    """Read the MJCF `path`.

    Args:
        path: Path of the file.
        files: Path -> content.
        whole: Put everything that is fixed to the world into one body, `WHOLE`.

    Raises:
        RuleError: MuJoCo cannot load it, a mesh is missing, or it contains elements that no robot has.
    """
    with warnings.catch_warnings():
        # A prefix is told to be missing, but the model is compiled and written all the same.
        warnings.filterwarnings("ignore", "Attaching a spec with an empty prefix", UserWarning)
        return _read(path, files, whole=whole)


def _read(path: str, files: Mapping[str, bytes], *, whole: bool) -> Source:
    spec = _loaded(path, files)
    found = Source(spec)
    _name_all(spec)
    skins = list(spec.skins)
    for skin in skins:
        spec.delete(skin)
    _take_files(spec, path, files)
    _fix_bases(spec, found)
    for joint in spec.joints:
        if joint.type not in _MOVING:
            raise wrong(
                f"joint `{joint.name}` of body `{joint.parent.name}` is "
                + ("free" if joint.type == mujoco.mjtJoint.mjJNT_FREE else "a ball"),
                hint="a robot has hinges and slides",
            )
    try:
        model = spec.compile()
    except ValueError as error:
        raise wrong(f"`{path}` does not compile", MuJoCo=str(error).strip()) from None
    _state_inertias(spec, model)
    _read_drives(spec, model, found)
    _read_couplings(spec, found)
    if model.nkey:
        for number in range(model.njnt):
            found.home[model.joint(number).name] = float(model.key_qpos[0][model.jnt_qposadr[number]])
    for kind, count in (("tendons", len(spec.tendons)), ("flexes", len(spec.flexes)), ("skins", len(skins))):
        if count:
            found.dropped.append(f"{count} {kind}")
    # Degrees, Euler angles and defaults of the file are resolved, so that its bodies can be combined with other files.
    text = precise(spec.to_xml(), spec.compile())
    found.spec = mujoco.MjSpec.from_string(_only_bodies(text, whole), assets=dict(spec.assets))
    return found


def _loaded(path: str, files: Mapping[str, bytes]) -> Any:
    """The `mujoco.MjSpec` of a file; MuJoCo reads attached models from the disk only."""
    # Warnings would be printed, and written to `MUJOCO_LOG.TXT` in the user's folder; what is wrong is an error later.
    mujoco.set_mju_user_warning(lambda message: None)
    with tempfile.TemporaryDirectory() as folder:
        for name, text in flat.written(path, files).items():
            place = Path(folder, name)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(text)
        try:
            return mujoco.MjSpec.from_file(str(Path(folder, path)))
        except ValueError as error:
            raise wrong(f"`{path}` does not load", MuJoCo=str(error).strip()) from None


def _only_bodies(text: str, whole: bool) -> str:
    """MJCF without settings of the simulation, and with everything in one body if `whole`."""
    root = ET.fromstring(text)
    for tag in ("option", "size", "visual", "statistic", "keyframe"):
        for element in root.findall(tag):
            root.remove(element)
    # The root class of a model that is attached without a prefix has no name, and MuJoCo does not read what it wrote.
    for number, element in enumerate(each for each in root.findall("default/default") if not each.get("class")):
        if any(each.tag != "default" for each in element):
            raise wrong("a model attached without a prefix sets defaults of no class", hint="attach it with a prefix")
        element.set("class", f"attached_{number}")
    world = root.find("worldbody")
    if whole and world is not None:
        children = [each for each in world if each.tag in ("body", "frame", "geom", "site")]
        holder = ET.SubElement(world, "body", name=WHOLE)
        for each in children:
            world.remove(each)
            holder.append(each)
    return ET.tostring(root, encoding="unicode")


def _fix_bases(spec: Any, found: Source) -> None:
    """Remove free joints of bodies in the world: the base of a robot model is fixed."""
    loose = [
        joint for body in spec.worldbody.bodies for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE
    ]
    for joint in loose:
        found.dropped.append(f"free joint of `{joint.parent.name}`, which is fixed now")
        spec.delete(joint)
    if loose:
        for key in list(spec.keys):  # the size has changed
            spec.delete(key)


def _name_all(spec: Any) -> None:
    """Name bodies, joints and meshes without a name, so that all can be identified."""
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints)):
        taken = {each.name for each in elements}
        for number, each in enumerate(elements):
            if not each.name:
                name = f"{kind}_{number}"
                each.name = name if name not in taken else f"{name}_"
    for each in spec.meshes:
        if not each.name and each.file:
            each.name = Path(each.file).stem
    for each in spec.textures:
        if not each.name and each.file:
            each.name = Path(each.file).stem


def _take_files(spec: Any, path: str, files: Mapping[str, bytes]) -> None:
    """Replace file names by names of assets, so that models from different folders can be joined."""
    assets: dict[str, bytes] = {}

    def taken(named: str, below: str, asset: str) -> str:
        """Name of the asset for a file, starting with `asset`; empty if no file is named."""
        if not named:
            return ""
        named = posixpath.join(below, posixpath.basename(named) if spec.strippath else named)
        found = posixpath.normpath(posixpath.join(posixpath.dirname(path), named))
        if found not in files:
            found = meshes.found(named, path, files)
        read = meshes.mesh if asset.startswith("mesh") else meshes.picture
        name, data = read(found, files[found])
        assets[f"{asset}_{name}"] = data
        return f"{asset}_{name}"

    for number, each in enumerate(spec.meshes):
        each.file = taken(each.file, spec.meshdir, f"mesh_{number}")
    for number, each in enumerate(spec.textures):
        each.file = taken(each.file, spec.texturedir, f"texture_{number}")
        sides = enumerate(each.cubefiles)
        each.cubefiles = [taken(file, spec.texturedir, f"texture_{number}_{side}") for side, file in sides]
    spec.meshdir = spec.texturedir = ""
    spec.assets = assets


def _state_inertias(spec: Any, model: Any) -> None:
    """Write the inertia that MuJoCo computes with the file's own settings, which are not copied with its bodies."""
    for body in spec.bodies[1:]:
        known = model.body(body.name)
        body.explicitinertial, body.fullinertia = True, [np.nan] * 6
        body.mass, body.ipos = float(known.mass[0]), known.ipos.copy()
        body.iquat, body.inertia = known.iquat.copy(), known.inertia.copy()
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _read_drives(spec: Any, model: Any, found: Source) -> None:
    """Torques and gains of the actuators on joints."""
    for number in range(model.nu):
        if model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_JOINT:
            found.dropped.append(f"actuator `{model.actuator(number).name}`, which drives no single joint")
            continue
        joint = model.joint(int(model.actuator_trnid[number, 0]))
        gear = abs(float(model.actuator_gear[number, 0])) or 1.0
        gain, bias = model.actuator_gainprm[number], model.actuator_biasprm[number]
        position = bias[1] < 0 and np.isclose(bias[1], -gain[0])
        if model.actuator_forcelimited[number]:
            found.efforts[joint.name] = gear * float(np.abs(model.actuator_forcerange[number]).max())
        elif not bias.any() and model.actuator_ctrllimited[number]:
            found.efforts[joint.name] = gear * float(gain[0] * np.abs(model.actuator_ctrlrange[number]).max())
        if position:
            found.gains[joint.name] = (gear * gear * float(gain[0]), gear * gear * max(0.0, float(-bias[2])))
    for number in range(model.njnt):
        if model.jnt_actfrclimited[number]:
            name = model.joint(number).name
            found.efforts.setdefault(name, float(np.abs(model.jnt_actfrcrange[number]).max()))


def _read_couplings(spec: Any, found: Source) -> None:
    """Joints that follow others by a linear equality; raises for anything that closes a loop."""
    for each in spec.equalities:
        if each.type == mujoco.mjtEq.mjEQ_JOINT and each.name2:
            offset, ratio, *curved = (float(value) for value in each.data[:5])
            if any(curved):
                raise wrong(
                    f"joint `{each.name1}` follows `{each.name2}` by a curve (polycoef {offset:g} {ratio:g} ...)",
                    hint='approximate it by a line: `polycoef="offset ratio 0 0 0"`',
                )
            found.mimics[each.name1] = (each.name2, ratio, offset)
        elif each.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            raise wrong(
                f"`{each.name1}` and `{each.name2}` close a loop",
                hint="a robot is a tree: replace the closing constraint by joints that follow one (<equality><joint>)",
            )
