"""Loading a twin from memory."""

from __future__ import annotations

import mujoco
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model import model
from tests import episodes


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
