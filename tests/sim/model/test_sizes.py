"""Objects of a compiled model are resized as if they had been compiled at that size."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.sim.model.sizes import Sizes

SCENE = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  {a} 0 0  0 {b} 0  0 0 {c}"/>
    <mesh name="other" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="thing" pos="0.1 0.2 0.3">
      <freejoint/>
      <inertial pos="{d} 0 {e}" mass="0.3" diaginertia="0.01 0.012 0.014"/>
      <geom type="mesh" mesh="wedge" pos="{e} 0 0" euler="10 20 30"/>
      <geom type="capsule" size="{d} {e}" pos="0 {e} 0"/>
      <site name="mark" pos="{a} 0 0" size="{d} {d} {d}"/>
      <body name="drawer" pos="0 {b} {c}">
        <inertial pos="0 {d} 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
        <joint name="slide" type="slide" axis="1 0 0" range="0 {a}"/>
        <joint name="hinge" type="hinge" axis="0 1 0" pos="{d} 0 {e}" range="0 1.2"/>
        <geom type="box" size="{d} {d} {e}" pos="{e} 0 0"/>
        <geom type="mesh" mesh="wedge" pos="0 0 {e}"/>
      </body>
    </body>
    <body name="still" pos="0.5 0.2 0.3">
      <freejoint/>
      <geom type="mesh" mesh="other"/>
    </body>
  </worldbody>
</mujoco>
"""
SIZES = {"a": 0.12, "b": 0.07, "c": 0.09, "d": 0.01, "e": 0.02}
DERIVED = ("invweight", "M0", "mesh_scale", "mesh_pos", "mesh_quat", "actuator", "mesh_octadr")
"""Fields that depend on inertia, which sizes leave alone, or only tell how a mesh was made."""


def compiled(scale: float = 1.0):
    compiler = '<compiler angle="radian"/><asset>'
    sizes = {name: f"{scale * size:.12g}" for name, size in SIZES.items()}
    return mujoco.MjModel.from_xml_string(SCENE.replace("<asset>", compiler).format(**sizes))


def arrays(model) -> dict[str, np.ndarray]:
    names = (name for name in dir(model) if not name.startswith("_") and not any(part in name for part in DERIVED))
    found = {name: getattr(model, name) for name in names}
    return {name: value.copy() for name, value in found.items() if isinstance(value, np.ndarray) and value.size}


def test_a_resized_model_is_as_one_compiled_at_that_size():
    model = compiled()
    first = arrays(model)
    sizes = Sizes(["thing", "still"], model)
    for scale in (1.3, 0.8):
        sizes.put({"thing": scale})
        wanted = arrays(compiled(scale))
        for name, value in arrays(model).items():
            assert np.allclose(value, wanted[name], rtol=1e-4, atol=1e-6), name
    sizes.put({})
    for name, value in arrays(model).items():
        assert np.array_equal(value, first[name]), name


def test_a_larger_object_touches_earlier():
    model = compiled()
    data = mujoco.MjData(model)
    data.qpos[2] = 0.06
    sizes = Sizes(["thing"], model)
    contacts = []
    for scale in (1.0, 4.0):
        sizes.put({"thing": scale})
        mujoco.mj_forward(model, data)
        contacts.append(data.ncon)
    assert contacts[0] == 0 < contacts[1]
