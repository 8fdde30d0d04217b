"""`dxb new task` proposes what the robot can do."""

from __future__ import annotations

import pytest

from dextera_build.recipe import strict_yaml
from tests.e2e.space import Space

URDF = """
<robot name="stick">
  <link name="base">
    <inertial><mass value="3"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  LINKS
</robot>
"""
LINK = """
  <link name="link_NUMBER">
    <inertial>
      <origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.16"/></geometry></collision>
  </link>
  <joint name="joint_NUMBER" type="revolute">
    <parent link="PARENT"/><child link="link_NUMBER"/><origin xyz="0 0 0.2"/><axis xyz="AXIS"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/>
  </joint>
"""


def arm() -> str:
    """Six joints and no hand."""
    links = ""
    for number in range(1, 7):
        parent, axis = f"link_{number - 1}" if number > 1 else "base", "0 1 0" if number % 2 else "0 0 1"
        links += LINK.replace("NUMBER", str(number)).replace("PARENT", parent).replace("AXIS", axis)
    return URDF.replace("LINKS", links)


@pytest.mark.slow
def test_a_robot_without_a_hand_gets_tasks_that_it_pushes(space: Space) -> None:
    space.write("dxb.toml", 'cache = "cache"\nprofile = "stub"\n')
    space.write("robots/stick.urdf", arm())
    assert space.dxb("new", "robot", "robots/stick.urdf").code == 0
    built = space.dxb("build", "robot/stick")
    assert built.code == 0, built.err
    told = space.dxb("new", "task", "twin/box_table", "robot/stick")
    assert told.code == 0, told.err
    assert "left out, because robot/stick has no grip that holds: Lift" in told.err
    recipe = strict_yaml.parse((space.root / "recipes/task/box_table_tasks.yaml").read_text(), "tasks").plain()
    primitives = {node["primitive"] for node in recipe["nodes"].values() if "primitive" in node}
    assert primitives
    assert primitives <= {"push", "articulate"}
    every = space.dxb("new", "task", "twin/box_table", "-o", "recipes/task/all.yaml")
    assert "left out" not in every.err
    assert "Lift" in every.out
