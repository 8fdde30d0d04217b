"""Models name files of their own folder: MuJoCo would look for all others on the disk."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model import compose
from dextera_build.sim.model.model import compile_folder
from tests.rules.simulate.robot_files import cube

SCENE = """<mujoco><compiler meshdir="assets"/><asset>%s<mesh name="c" file="cube.stl"/></asset>
  <worldbody><body><geom type="mesh" mesh="c"/>%s</body></worldbody></mujoco>"""


def scene(asset: str = "", body: str = "") -> Folder:
    return Folder(files={"scene.xml": (SCENE % (asset, body)).encode(), "assets/cube.stl": cube()})


def test_a_model_of_its_own_files_is_read():
    assert compile_folder(scene()).nmesh == 1
    assert len(compose.load(scene(), "scene.xml").meshes) == 1


@pytest.mark.parametrize(
    ("asset", "body", "element"),
    [
        ('<mesh name="m" file="{}"/>', "", "mesh"),
        ('<texture name="t" type="2d" file="{}"/>', "", "texture"),
        ('<texture name="t" type="cube" fileright="{}"/>', "", "texture"),
        ('<hfield name="h" size="1 1 1 1" file="{}"/>', "", "hfield"),
        ('<model name="m" file="{}"/>', "", "model"),
        ("", '<include file="{}"/>', "include"),
    ],
)
@pytest.mark.parametrize("name", ["{}/out/a.stl", "../a.stl", "a.stl", "&#46;./a.stl"])
def test_a_model_that_names_other_files_is_refused(tmp_path, monkeypatch, name, asset, body, element):
    (tmp_path / "out").mkdir()
    for place in ("out/a.stl", "a.stl"):
        (tmp_path / place).write_bytes(
            cube() if element in ("mesh", "hfield", "texture") else b"<m><geom size='1'/></m>"
        )
    monkeypatch.chdir(tmp_path / "out")
    named = name.format(tmp_path)
    folder = scene(asset.format(named), body.format(named))
    for load in (compile_folder, lambda each: compose.load(each, "scene.xml")):
        with pytest.raises(RuleError, match="is not in its folder") as caught:
            load(folder)
        assert caught.value.facts["element"] == f"<{element}>"
