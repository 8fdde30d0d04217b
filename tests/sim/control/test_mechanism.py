"""Joints as something to be pushed, on a lid whose geometry is known."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.sim.control.mechanism import Mechanism

CASE = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="case" pos="0.3 0.1 0.02" euler="0 0 0.8">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.02"/>
      <body name="lid" pos="0 0.1 0.02">
        <joint name="hinge" axis="-1 0 0" range="0 2.2"/>
        <geom type="box" size="0.1 0.1 0.005" pos="0 -0.1 0.005"/>
      </body>
      <body name="drawer">
        <joint name="slide" type="slide" axis="1 0 0" range="0 0.1"/>
        <geom type="box" size="0.05 0.04 0.01"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(CASE)


def test_the_open_lid_stands_up(model: mujoco.MjModel) -> None:
    """In the frame of the case, wherever that stands."""
    pose = Mechanism(model, "hinge").pose(np.pi / 2)
    assert np.allclose(pose[:3, 3], [0.0, 0.1, 0.02], atol=1e-9)
    assert np.allclose(pose[:3, :3] @ [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(("way", "height"), [(-1.0, 0.01), (1.0, 0.0)])
def test_a_lid_is_pushed_at_its_far_edge_from_behind(model: mujoco.MjModel, way: float, height: float) -> None:
    """Closing pushes on the outer face, opening on the inner one."""
    place, along = Mechanism(model, "hinge").pushed_at(way, 1.0)
    assert np.allclose(place, [0.0, -0.2, height], atol=6e-3)
    assert along[2] == pytest.approx(np.sign(way), abs=0.05)


def test_half_way_out_is_half_way_out(model: mujoco.MjModel) -> None:
    mechanism = Mechanism(model, "hinge")
    far, near = (mechanism.pushed_at(-1.0, share)[0] for share in (1.0, 0.5))
    assert near[1] == pytest.approx(far[1] / 2, rel=0.05)


def test_a_drawer_is_pushed_at_its_back(model: mujoco.MjModel) -> None:
    place, along = Mechanism(model, "slide").pushed_at(0.1, 1.0)
    assert np.allclose(along, [1.0, 0.0, 0.0])
    assert np.allclose(place, [-0.05, 0.0, 0.0], atol=1e-9)
