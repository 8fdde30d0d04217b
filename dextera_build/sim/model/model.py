"""Load a written twin into MuJoCo from memory."""

from __future__ import annotations

import io
from typing import Any

from PIL import Image

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model import own_files


def compile_folder(model: Folder) -> Any:
    """The `mujoco.MjModel` of a folder with `scene.xml` and its files.

    Raises:
        RuleError: `scene.xml` is missing, names a file that the folder does not contain, or MuJoCo rejects it.
    """
    import mujoco

    # Keep MuJoCo from writing `MUJOCO_LOG.TXT` to the user's folder; `MjData.warning` and speeds show divergence.
    mujoco.set_mju_user_warning(lambda message: None)
    if "scene.xml" not in model.files:
        raise RuleError("the folder holds no `scene.xml`", code="DXB-B210", facts={"files": len(model.files)})
    own_files.check("scene.xml", model.files)
    others = {name: data for name, data in model.files.items() if name != "scene.xml"}
    try:
        return mujoco.MjModel.from_xml_string(model.files["scene.xml"].decode(), others)
    except ValueError as error:
        raise RuleError("MuJoCo does not load `scene.xml`", code="DXB-B211", facts={"MuJoCo": error}) from None


def untextured(model: Folder) -> Folder:
    """The folder with pictures of one pixel: the same physics, in a fraction of the memory of many copies.

    A model with height fields, whose heights may be pictures, stays as it is.
    """
    if b"<hfield" in model.files.get("scene.xml", b""):
        return model
    pixel = io.BytesIO()
    Image.new("RGB", (1, 1)).save(pixel, "PNG")
    return Folder(
        files={name: pixel.getvalue() if name.endswith(".png") else data for name, data in model.files.items()}
    )


def at_home(model: Any) -> Any:
    """A `mujoco.MjData` at keyframe `home`, if the model has one, with all derived quantities computed."""
    import mujoco

    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return data
