"""What rule simulate.robot refuses, on a pendulum."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from dextera_build.artifacts.robots.robot import ACCELERATION
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

BALL = {"shape": "sphere", "radius_m": 0.05, "colour": "red"}
LINK = {"mass_kg": 1.0, "centre_m": (0.0, 0.0, 0.0), "inertia_kgm2": (0.01, 0.01, 0.01), "pieces": (BALL,)}
HINGE = {
    "name": "hinge",
    "lower_rad": -1.0,
    "upper_rad": 1.0,
    "velocity_rad_s": 1.0,
    "effort_nm": 5.0,
    "stiffness_nm_rad": 10.0,
    "damping_nms_rad": 1.0,
}
PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "source": "made up",
    "colours": {"red": (1.0, 0.0, 0.0)},
    "chains": (
        {"group": "arm", "mounts": ({},), "links": (LINK | {"name": "base"},)},
        {
            "group": "hand",
            "mounts": ({"parent": "base", "prefix": "left_"}, {"parent": "base", "prefix": "right_"}),
            "links": (LINK | {"name": "bob", "at_m": (0.0, 0.0, 0.3), "joint": HINGE},),
        },
    ),
    "frames": {"tip": {"link": "left_bob"}},
}


def pendulum(path: tuple[str | int, ...], value: object) -> dict[str, Any]:
    """`PENDULUM` with one value replaced."""

    def replaced(inner: Any, rest: tuple[str | int, ...]) -> Any:
        if not rest:
            return value
        if isinstance(inner, tuple):
            return tuple(replaced(item, rest[1:]) if i == rest[0] else item for i, item in enumerate(inner))
        return inner | {rest[0]: replaced(inner.get(rest[0]), rest[1:])}

    options: dict[str, Any] = replaced(copy.deepcopy(PENDULUM), path)
    return options


def test_each_mount_gets_its_own_copy(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    robot = runner.run("simulate.robot", options=PENDULUM)
    assert robot.names("hand") == ("left_hinge", "right_hinge")
    assert robot.links == {"base": "arm", "left_bob": "hand", "right_bob": "hand"}
    assert runner.outcome.metrics["mass"] == (3.0, "kg")
    assert runner.encode(robot) == runner.encode(runner.run("simulate.robot", options=PENDULUM))


def test_a_joint_has_the_acceleration_that_it_or_the_robot_states(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)

    def found(options: dict[str, Any]) -> set[float]:
        return {joint.acceleration for joint in runner.run("simulate.robot", options=options).joints}

    slow = PENDULUM | {"acceleration_rad_s2": 3.0}
    assert found(PENDULUM) == {ACCELERATION}
    assert found(slow) == {3.0}
    assert found(pendulum((*BOB, "joint", "acceleration_rad_s2"), 4.0) | {"acceleration_rad_s2": 3.0}) == {4.0}


BOB: tuple[str | int, ...] = ("chains", 1, "links", 0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("chains", 1, "mounts", 0, "parent"), "elbow", "`elbow` carries a chain, but no link is called so"),
        (("chains", 1, "mounts", 1, "prefix"), "left_", "two links are called `left_bob`"),
        (("chains", 0, "links", 0, "name"), "foot", "`base` carries a chain"),
        (("frames", "tip", "link"), "bob", "no link is called `bob`"),
        (("apart",), (("base", "bob"),), "no link is called `bob`"),
        ((*BOB, "joint", "home_rad"), 1.5, "home of joint `left_hinge` is outside its limits"),
        ((*BOB, "pieces", 0, "colour"), "blue", "link `left_bob` has an unknown colour `blue`"),
        ((*BOB, "pieces", 0, "radius_m"), 0.0, "a sphere of link `left_bob` needs `radius_m`"),
        ((*BOB, "pieces", 0, "shape"), "capsule", "a capsule of link `left_bob` needs `from_m`, `to_m` and `radius_m`"),
        ((*BOB, "pieces", 0, "shape"), "box", "a box of link `left_bob` needs `half_m`"),
    ],
)
def test_wrong_descriptions_are_refused(
    tmp_path: Path, path: tuple[str | int, ...], value: object, message: str
) -> None:
    with pytest.raises(RuleError) as error:
        RuleRunner(tmp_path).run("simulate.robot", options=pendulum(path, value))
    assert message in error.value.message


FOLLOWER = {"name": "tail", "leader": "hinge", "ratio": 0.5, "offset_rad": 0.1}
TAIL = LINK | {"name": "tail", "at_m": (0.0, 0.0, 0.3), "follower": FOLLOWER}


def test_a_follower_has_no_actuator_and_is_no_action(tmp_path: Path) -> None:
    links = (*PENDULUM["chains"][1]["links"], TAIL)
    robot = RuleRunner(tmp_path).run("simulate.robot", options=pendulum(("chains", 1, "links"), links))
    assert [joint.name for joint in robot.joints] == ["left_hinge", "right_hinge"]
    assert [(follower.name, follower.leader) for follower in robot.followers] == [
        ("left_tail", "left_hinge"),
        ("right_tail", "right_hinge"),
    ]
    assert robot.followed({"left_hinge": 0.4}) == pytest.approx({"left_hinge": 0.4, "left_tail": 0.3})
    text = robot.model.files["robot.xml"].decode()
    assert text.count("<general ") == 2
    assert text.count('joint2="left_hinge"') == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"follower": FOLLOWER | {"leader": "elbow"}}, "`left_tail` follows `left_elbow`, but no actuated joint"),
        ({"follower": FOLLOWER | {"name": "hinge"}}, "two joints are called `left_hinge`"),
        ({"joint": HINGE | {"name": "own"}}, "link `left_tail` has a joint and a follower"),
    ],
)
def test_wrong_followers_are_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    links = (*PENDULUM["chains"][1]["links"], TAIL | change)
    with pytest.raises(RuleError) as error:
        RuleRunner(tmp_path).run("simulate.robot", options=pendulum(("chains", 1, "links"), links))
    assert message in error.value.message


def test_the_first_link_is_called_base(tmp_path: Path) -> None:
    options = pendulum(("chains",), ({"group": "arm", "mounts": ({},), "links": (LINK | {"name": "foot"},)},))
    with pytest.raises(RuleError, match="the first link is not called `base`"):
        RuleRunner(tmp_path).run("simulate.robot", options=options | {"frames": {}})
