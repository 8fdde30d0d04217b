"""Rule simulate.mjcf: what MuJoCo reads for a model is what the rule returns, and what makes it stale."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

ARM = """<mujoco>
  <compiler meshdir="../shapes" texturedir="pictures"/>
  <include file="parts/bob.xml"/>
  <asset>
    <mesh name="wedge" file="wedge.obj"/>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" width="8" height="8"/>
  </asset>
  <worldbody><geom type="mesh" mesh="wedge"/></worldbody>
</mujoco>
"""
BOB = """<mujocoinclude>
  <include file="far.xml"/>
  <include file="parts/tip.xml"/>
</mujocoinclude>
"""
FAR = '<mujocoinclude><worldbody><geom name="%s" size="0.1"/></worldbody></mujocoinclude>'
WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    files = {
        "robots/arm/arm.xml": ARM,
        "robots/arm/parts/bob.xml": BOB,
        "robots/arm/parts/far.xml": FAR % "beside",
        "robots/arm/parts/tip.xml": FAR % "tip",
        "robots/shapes/wedge.obj": WEDGE,
        "robots/shapes/unused.obj": WEDGE,
    }
    for name, text in files.items():
        path = tmp_path / "project" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "project"


def gathered(project: Path, path: str = "robots/arm/arm.xml") -> tuple[Folder, list[list[str]]]:
    runner = RuleRunner(project.parent / "scratch", files=project)
    folder: Folder = runner.run("simulate.mjcf", options={"path": path})
    return folder, runner.reads


def geoms(path: Path) -> list[str]:
    model = mujoco.MjModel.from_xml_path(str(path))
    return [model.geom(number).name for number in range(model.ngeom)]


def test_what_it_returns_loads_elsewhere_as_the_original(project: Path, tmp_path: Path) -> None:
    folder, _ = gathered(project)
    assert set(folder.files) == {
        "arm/arm.xml",
        "arm/parts/bob.xml",
        "arm/parts/far.xml",
        "arm/parts/tip.xml",
        "shapes/wedge.obj",
    }
    truth = geoms(project / "robots" / "arm" / "arm.xml")
    folder.export(tmp_path / "there", "model")
    shutil.rmtree(project)
    assert geoms(tmp_path / "there" / "arm" / "arm.xml") == truth == ["beside", "tip", ""]


def test_an_include_is_looked_for_from_the_models_folder_first_as_mujoco_does(project: Path) -> None:
    (project / "robots/arm/far.xml").write_text(FAR % "above")
    assert geoms(project / "robots/arm/arm.xml") == ["above", "tip", ""]
    folder, _ = gathered(project)
    assert "arm/far.xml" in folder.files
    assert "arm/parts/far.xml" not in folder.files


def test_it_asks_for_what_the_model_names_and_for_nothing_else(project: Path) -> None:
    asked = {(kind, name) for kind, name, _ in gathered(project)[1]}
    assert {name for kind, name in asked if kind == "file"} == {
        "robots/arm/arm.xml",
        "robots/arm/parts/bob.xml",
        "robots/arm/parts/far.xml",
        "robots/arm/parts/tip.xml",
        "robots/shapes/wedge.obj",
    }
    assert ("there", "robots/arm/far.xml") in asked  # were it there, it would be the one that is included


@pytest.mark.parametrize(
    ("settings", "name", "found"),
    [
        ('assetdir="../shapes"', "wedge.obj", "shapes/wedge.obj"),
        ('assetdir="elsewhere" meshdir="../shapes"', "wedge.obj", "shapes/wedge.obj"),
        ('meshdir="../shapes" strippath="true"', "lost/wedge.obj", "shapes/wedge.obj"),
        ("", "../shapes/wedge.obj", "shapes/wedge.obj"),
    ],
)
def test_meshes_are_looked_for_where_mujoco_does(project: Path, settings: str, name: str, found: str) -> None:
    path = project / "robots" / "arm" / "arm.xml"
    text = ARM.replace('meshdir="../shapes" texturedir="pictures"', settings).replace("wedge.obj", name)
    path.write_text(text)
    assert len(geoms(path)) == 3
    assert found in gathered(project)[0].files


def test_an_attached_model_brings_its_own_files(project: Path) -> None:
    whole = '<mujoco><asset><model name="arm" file="arm/arm.xml"/></asset></mujoco>'
    (project / "robots" / "cell.xml").write_text(whole)
    folder, _ = gathered(project, "robots/cell.xml")
    assert {"cell.xml", "arm/arm.xml", "arm/parts/tip.xml", "shapes/wedge.obj"} <= set(folder.files)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco>", "`robots/arm/arm.xml` is not valid XML"),
        ('<?xml version="1.0" encoding="nonsense"?><mujoco/>', "`robots/arm/arm.xml` is not valid XML"),
        ('<?xml version="1.0" encoding="utf-7"?><mujoco/>', "`robots/arm/arm.xml` is not valid XML"),
        ("<robot/>", "`robots/arm/arm.xml` is not MJCF"),
        ('<mujoco><include file="gone.xml"/></mujoco>', "gone.xml"),
        ('<mujoco><include file="../../../etc/passwd"/></mujoco>', "passwd"),
    ],
)
def test_what_cannot_be_gathered_is_one_error(project: Path, text: str, message: str) -> None:
    (project / "robots" / "arm" / "arm.xml").write_text(text)
    with pytest.raises(RuleError) as error:
        gathered(project)
    assert message in error.value.message
