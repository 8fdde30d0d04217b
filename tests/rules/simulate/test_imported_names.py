"""What a robot model cannot have as a file states it: links `world` and `base`, inertias; and hands on arms."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.sim.model.imported import inertia
from dextera_build.testing import RuleRunner
from tests.rules.simulate.robot_files import ARM, arm, both
from tests.rules.simulate.test_imported_robot import SPEEDS, URDF, compiled, made, poses

BARE = "arm_description/urdf/arm.urdf"


@pytest.mark.medium
def test_a_root_called_world_is_the_base(tmp_path):
    text = ARM.replace('"base_link"', '"world"')
    robot = made(tmp_path, arm(text), parts=[{"file": URDF}])
    plain = made(tmp_path, arm(), parts=[{"file": URDF}])
    assert robot.links == plain.links
    posture = {"shoulder": 0.3, "elbow": -0.4}
    ours, theirs = (poses(compiled(each), "base", posture) for each in (robot, plain))
    for link, pose in theirs.items():
        np.testing.assert_allclose(ours[link], pose, atol=1e-12)
    whole = made(tmp_path, arm(text), parts=[{"file": URDF, "root": "world"}])
    assert whole.links == plain.links


def test_another_link_called_base_gets_a_name_of_its_own(tmp_path):
    runner = RuleRunner(tmp_path)
    robot = made(tmp_path, arm(ARM.replace('"tool0"', '"base"')), runner, parts=[{"file": URDF}])
    assert set(robot.links) == {"base", "upper", "fore", "base_frame", "left", "right"}
    assert any("link `base` is called `base_frame`" in each for each in runner.outcome.warnings)


@pytest.mark.medium
def test_impossible_inertias_are_all_named_and_repaired_on_request(tmp_path):
    text = ARM.replace('izz="0.001"', 'izz="0.1"').replace('izz="0.0001"', 'izz="0"')
    with pytest.raises(RuleError) as caught:
        made(tmp_path, arm(text), parts=[{"file": URDF}])
    assert "link `fore` has principal moments" in caught.value.message
    assert caught.value.facts["also"] == "left, right"
    assert "repair_inertias: true" in (caught.value.hint or "")
    robot = made(tmp_path, arm(text), parts=[{"file": URDF, "repair_inertias": True}])
    model = compiled(robot)
    np.testing.assert_allclose(np.sort(model.body("fore").inertia), [0.05, 0.05, 0.1], rtol=1e-6)
    np.testing.assert_allclose(
        np.sort(model.body("upper").inertia),
        np.sort(compiled(made(tmp_path, arm(), parts=[{"file": URDF}])).body("upper").inertia),
    )


def test_a_negative_mass_cannot_be_repaired(tmp_path):
    text = ARM.replace('<mass value="1.2"/>', '<mass value="-1.2"/>')
    with pytest.raises(RuleError, match=r"link `fore` has mass -1\.2 kg"):
        made(tmp_path, arm(text), parts=[{"file": URDF, "repair_inertias": True}])


def test_repaired_moments_are_those_of_a_body_and_no_smaller():
    random = np.random.default_rng(3)
    for _ in range(300):
        mass = float(10.0 ** random.uniform(-9, 1))
        moments = mass * random.normal(0, 1, 3) * 10.0 ** random.uniform(-8, 0, 3)
        found = inertia.repaired(mass, moments)
        assert inertia.fault(mass, found) == ""
        floor = 0.4 * mass * inertia.RADIUS_M**2
        assert (found >= np.maximum(moments, floor) * (1 - 1e-12)).all()
        possible = np.sort(np.maximum(moments, floor))
        if possible[2] <= possible[0] + possible[1]:
            np.testing.assert_allclose(np.sort(found), possible)  # raised no more than needed


DRAWN = '<link name="tool0"><visual><geometry><box size="0.02 0.02 0.02"/></geometry></visual></link>'


@pytest.mark.medium
def test_what_a_link_of_solid_draws_touches(tmp_path):
    def touches(**part):
        text = ARM.replace('<link name="tool0"/>', DRAWN)
        model = compiled(made(tmp_path, arm(text), parts=[{"file": URDF, **part}]))
        body = model.body("tool0")
        first = int(body.geomadr[0])
        return [bool(model.geom_contype[geom]) for geom in range(first, first + int(body.geomnum[0]))]

    assert touches() == [False]
    assert touches(solid=["tool0"]) == [True]
    with pytest.raises(RuleError, match="has no link `tool1`"):
        touches(solid=["tool1"])


@pytest.mark.medium
def test_a_joint_above_the_palm_is_the_arms_though_its_link_is_a_part_of_the_hand(tmp_path):
    frames = {"palm": {"link": "tool0"}, "tip_left": {"link": "left"}, "tip_right": {"link": "right"}}
    robot = made(tmp_path, arm(), parts=[{"file": URDF}], hand=["fore"], frames=frames)
    assert robot.links["fore"] == "hand"
    assert robot.limbs["arm"].arm == ("shoulder", "elbow")
    assert robot.limbs["arm"].hand == ("grip",)


def test_moments_of_a_plate_stay_those_of_a_body_when_a_file_rounds_them():
    plate = np.array([1.23456789e-4, 3.456789e-5, 1.5805e-4])  # the largest exceeds the sum of the others by 0.02 %
    assert inertia.fault(1.0, plate) == ""
    rounded = [float(f"{value:.6g}") for value in inertia.balanced(plate)]
    assert sorted(rounded)[2] < sum(sorted(rounded)[:2])
    np.testing.assert_allclose(inertia.balanced(plate), plate, rtol=1e-3)
    assert (inertia.balanced(np.array([1.0, 1.0, 1.0])) == 1.0).all()


@pytest.mark.medium
def test_a_hand_is_attached_at_a_role_with_its_pose(tmp_path: Path):
    frames = {"flange": {"link": "tool0", "at_m": (0, 0, 0.02), "quaternion": (0, 0, 0, 1)}}
    arm_part = {"file": f"arm/{BARE}"}
    options = {"frames": frames, **SPEEDS}
    files = both()
    short = made(tmp_path, files, parts=[arm_part], attach={"hand": "hand/hand.xml", "at_m": (0, 0, 0.01)}, **options)
    part = {"file": "hand/hand.xml", "prefix": "hand_", "on": "tool0", "at_m": (0, 0, 0.03), "quaternion": (0, 0, 0, 1)}
    long = made(tmp_path, files, parts=[arm_part, part], hand=["hand_palm"], **options)
    assert short.links == long.links
    ours, theirs = (poses(compiled(each), "base", {"elbow": 0.4}) for each in (short, long))
    for link, pose in theirs.items():
        np.testing.assert_allclose(ours[link], pose, atol=1e-9)
    with pytest.raises(RuleError, match="`attach` names `wrist`, but no frame, link or site") as caught:
        made(tmp_path, files, parts=[arm_part], attach={"hand": "hand/hand.xml", "at": "wrist"}, **options)
    assert "tool0" in caught.value.facts["links"]
    assert re.search("flange", caught.value.facts["frames"])
