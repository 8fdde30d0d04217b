"""Loading a twin from memory."""

from __future__ import annotations

import io

import mujoco
import pytest
from PIL import Image

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model import model
from tests import episodes, task_bundles


def test_a_folder_without_a_scene_is_refused() -> None:
    with pytest.raises(RuleError, match=r"holds no `scene.xml`"):
        model.compile_folder(Folder(files={"readme": b""}))


def test_mujocos_reason_is_handed_on() -> None:
    with pytest.raises(RuleError, match=r"does not load `scene.xml`") as caught:
        model.compile_folder(Folder(files={"scene.xml": b"<mujoco><worldbody><geom mesh='x'/></worldbody></mujoco>"}))
    assert "MuJoCo" in caught.value.facts


def test_a_simulation_that_diverges_leaves_no_log_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    compiled = model.compile_folder(episodes.bundle().model)
    data = mujoco.MjData(compiled)
    data.qvel[:] = 1e12
    mujoco.mj_step(compiled, data, 5)
    assert sum(warning.number for warning in data.warning) > 0
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_one_pixel_leave_the_physics_alone() -> None:
    bundle = task_bundles.lift()
    picture = io.BytesIO()
    Image.new("RGB", (64, 64)).save(picture, "PNG")
    asset = b'<asset><texture name="t" type="2d" file="t.png"/><material name="m" texture="t"/></asset><worldbody>'
    scene = bundle.model.files["scene.xml"].replace(b"<worldbody>", asset, 1)
    whole = Folder(files={"scene.xml": scene, "t.png": picture.getvalue()})
    models = [model.compile_folder(folder) for folder in (whole, model.untextured(whole))]
    assert [each.ntexdata for each in models] == [64 * 64 * 3, 3]
    states = []
    for each in models:
        data = model.at_home(each)
        mujoco.mj_step(each, data, 50)
        states.append(data.qpos.tobytes())
    assert states[0] == states[1]
