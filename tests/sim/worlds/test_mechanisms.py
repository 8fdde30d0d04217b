"""A door on a vertical hinge, a drawer in its cabinet, a lid on its base: at rest, pushed, let go, at their ends."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset, Body, Collision, Joint, Link, Pieces
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.sim.model import model
from dextera_build.sim.worlds import settle
from tests import factories, twins

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]
PARTS: dict[str, tuple[list[Corners], list[Corners], dict[str, Any]]] = {
    # A plate with a post; the door hangs on the post and opens towards the viewer.
    "door": (
        [((-0.2, -0.15, 0.0), (0.2, 0.15, 0.02)), ((-0.2, 0.1, 0.02), (-0.17, 0.13, 0.32))],
        [((-0.165, 0.105, 0.03), (0.15, 0.125, 0.3))],
        {"type": "revolute", "origin": (-0.17, 0.115, 0.03), "axis": (0.0, 0.0, -1.0), "upper": 1.6, "position": 0.6},
    ),
    # A box open in front, and a tray in it that comes out along -y.
    "drawer": (
        [
            ((-0.15, -0.12, 0.0), (0.15, 0.12, 0.02)),
            ((-0.15, -0.12, 0.12), (0.15, 0.12, 0.14)),
            ((-0.15, -0.12, 0.02), (-0.13, 0.12, 0.12)),
            ((0.13, -0.12, 0.02), (0.15, 0.12, 0.12)),
            ((-0.13, 0.1, 0.02), (0.13, 0.12, 0.12)),
        ],
        [((-0.125, -0.118, 0.025), (0.125, 0.095, 0.1))],
        {"type": "prismatic", "origin": (0.0, 0.0, 0.06), "axis": (0.0, -1.0, 0.0), "upper": 0.15, "position": 0.03},
    ),
    "lid": (
        [((-0.15, -0.1, 0.0), (0.15, 0.1, 0.08))],
        [((-0.15, -0.1, 0.0805), (0.15, 0.1, 0.09))],
        {"type": "revolute", "origin": (0.0, 0.1, 0.0805), "axis": (-1.0, 0.0, 0.0), "upper": 1.9, "position": 1.0},
    ),
}
STEP_S = 0.002


def asset(name: str) -> Asset:
    """One of the mechanisms, of 2 kg and 0.5 kg."""
    base, moving, about = PARTS[name]
    joint = Joint(name="move", parent="base", child="part", lower=0.0, **about)
    boxes = {"base": base, "part": moving}
    meshes = {link: [factories.box_mesh(*each) for each in own] for link, own in boxes.items()}
    hulls = {
        link: Pieces(hulls=tuple(Hull(vertices=each.vertices) for each in own), method="walls")
        for link, own in meshes.items()
    }
    inertials = {link: factories.box_inertial(*own[0], 2.0 if link == "base" else 0.5) for link, own in boxes.items()}
    links = {link: Link(mesh=_joined(own)) for link, own in meshes.items()}
    pose = factories.placed(factories.pose())
    return Asset(
        body=Body(links=links, joints=(joint,), pose=pose),
        physics=factories.physics(inertials),
        collision=Collision(links=hulls),
        pose=pose,
        category=name,
    )


def _joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(vertices=vertices, faces=np.concatenate(faces).astype(np.int32))


def loaded(name: str) -> tuple[Any, Any, Any]:
    """Model, state at home and the joint's rows."""
    made = twins.scene({name: asset(name)})
    compiled = model.compile_folder(made)
    return compiled, model.at_home(compiled), compiled.joint(f"{name}_part_move")


def pushed(compiled: Any, data: Any, joint: Any, force: float, seconds: float) -> tuple[float, float]:
    """Position and speed of the joint after a time under a torque or force."""
    for _ in range(round(seconds / STEP_S)):
        data.qfrc_applied[joint.dofadr[0]] = force
        mujoco.mj_step(compiled, data)
    return float(data.qpos[joint.qposadr[0]]), float(data.qvel[joint.dofadr[0]])


def model_name(compiled: Any, contact: Any) -> str:
    """Names of the two geoms of a contact."""
    return " ".join(compiled.geom(int(geom)).name for geom in contact.geom)


def friction(compiled: Any, joint: Any) -> float:
    return float(compiled.dof_frictionloss[joint.dofadr[0]])


@pytest.mark.parametrize("name", PARTS)
def test_it_rests_for_five_seconds_where_it_was_seen(name: str) -> None:
    made = twins.scene({name: asset(name)})
    run = settle.let_go(made, (name,), 5.0)
    (motion,) = run.motions
    assert motion.joints < 1e-3
    assert motion.drift_m < 5e-4
    assert motion.depth_m < 5e-4
    assert run.energy_change < 0.01


@pytest.mark.parametrize("name", PARTS)
def test_it_moves_when_pushed_beyond_its_friction_and_stops_when_let_go(name: str) -> None:
    compiled, data, joint = loaded(name)
    start = float(data.qpos[joint.qposadr[0]])
    still, _ = pushed(compiled, data, joint, 0.2 * friction(compiled, joint), 0.5)
    assert still == pytest.approx(start, abs=2e-3)
    gravity = abs(float(data.qfrc_bias[joint.dofadr[0]]))
    moved, _ = pushed(compiled, data, joint, 2.0 * friction(compiled, joint) + gravity, 0.3)
    assert moved > start + 0.005
    pushed(compiled, data, joint, 0.0, 1.0)
    held, speed = pushed(compiled, data, joint, 0.0, 1.0)
    assert abs(speed) < 1e-3
    later, _ = pushed(compiled, data, joint, 0.0, 1.0)
    assert later == pytest.approx(held, abs=1e-3)


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_stops_at_its_ends(name: str, sign: float) -> None:
    compiled, data, joint = loaded(name)
    low, high = (float(each) for each in compiled.jnt_range[joint.id])
    force = 1.5 * friction(compiled, joint) + abs(float(data.qfrc_bias[joint.dofadr[0]])) + 0.05
    end, speed = pushed(compiled, data, joint, sign * force, 4.0)
    assert end == pytest.approx(high if sign > 0 else low, abs=0.02 * (high - low))
    assert abs(speed) < 0.02
    depths = settle.penetrations(compiled, data)
    assert max(depths.values(), default=0.0) < 5e-4


def test_a_lid_lies_on_its_base() -> None:
    """Pressed shut and let go, it lies on the pieces of its base, which end half a millimetre below it."""
    compiled, data, joint = loaded("lid")
    pushed(compiled, data, joint, -2.0 * friction(compiled, joint), 2.0)
    angle, speed = pushed(compiled, data, joint, 0.0, 2.0)
    assert -0.001 < 0.2 * angle < 0.0
    assert any("part" in model_name(compiled, contact) for contact in data.contact)
    assert abs(speed) < 1e-3
