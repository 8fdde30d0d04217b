"""The written MJCF, judged on the compiled model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset, Collision, Joint, Link, Pieces
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.geometry import cameras, kinematics, quaternions, transforms
from dextera_build.sim.model import mjcf_contact, model, names
from dextera_build.sim.render import rendering
from tests import factories, twins


def build(assets: dict[str, Asset], lens: object = None) -> object:
    camera = lens or factories.camera()
    return twins.scene(assets, lens=camera)


@pytest.fixture(scope="module")
def assets() -> dict[str, Asset]:
    return {
        "Box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
        "bowl": factories.bowl_asset(factories.pose(0.3, -0.2)),
        "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4)),
    }


@pytest.fixture(scope="module")
def compiled(assets: dict[str, Asset]) -> tuple[object, object]:
    loaded = model.compile_folder(build(assets))
    return loaded, model.at_home(loaded)


def test_mass_properties_are_the_artifacts_own(assets: dict[str, Asset], compiled: tuple[object, object]) -> None:
    loaded, _ = compiled
    for (label, link), name in names.link_names(assets).items():
        wanted = assets[label].physics.links[link]
        body = loaded.body(name)
        assert body.mass[0] == pytest.approx(wanted.mass_kg)
        frame = quaternions.to_matrix(body.iquat)
        found = frame @ np.diag(body.inertia) @ frame.T
        np.testing.assert_allclose(np.diag(found), wanted.inertia[:3], rtol=1e-5)


def test_visuals_weigh_and_touch_nothing(compiled: tuple[object, object]) -> None:
    loaded, _ = compiled
    visual = loaded.geom_group == 2
    assert visual.sum() == 5
    assert not loaded.geom_contype[visual].any()
    assert not loaded.geom_conaffinity[visual].any()
    assert (loaded.geom_group[~visual] == 3).all()


@pytest.mark.parametrize("angle", [None, 0.0, 0.7, 2.2])
def test_links_stand_where_forward_kinematics_puts_them(
    assets: dict[str, Asset], compiled: tuple[object, object], angle: float | None
) -> None:
    loaded, _ = compiled
    data = model.at_home(loaded)
    body = assets["laptop"].body
    if angle is not None:
        data.qpos[loaded.joint("laptop_lid_hinge").qposadr[0]] = angle
    mujoco.mj_kinematics(loaded, data)
    wanted = kinematics.link_poses(body, None if angle is None else {"hinge": angle})["lid"]
    origin = np.array(body.joints[0].origin)
    found = transforms.rigid(quaternions.to_matrix(data.body("laptop_lid").xquat), data.body("laptop_lid").xpos)
    expected = assets["laptop"].pose.matrix @ wanted @ transforms.rigid(np.eye(3), origin)
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_chains_of_joints_and_sliders_agree_with_forward_kinematics() -> None:
    laptop = factories.laptop_asset(factories.pose(0.1, 0.0, 0.2, 0.5))
    links = dict(laptop.body.links)
    links["flap"] = Link(mesh=factories.box_mesh((-0.1, -0.2, 0.03), (0.1, -0.1, 0.04)))
    slide = Joint(
        name="slide",
        type="prismatic",
        parent="lid",
        child="flap",
        origin=(0.0, -0.1, 0.03),
        axis=(0.6, 0.0, 0.8),
        lower=0.0,
        upper=0.1,
        position=0.05,
    )
    body = laptop.body.model_copy(update={"links": links, "joints": (*laptop.body.joints, slide)})
    inertials = {**laptop.physics.links, "flap": laptop.physics.links["lid"]}
    pieces = {**laptop.collision.links, "flap": laptop.collision.links["lid"]}
    asset = laptop.model_copy(
        update={
            "body": body,
            "physics": factories.physics(inertials),
            "collision": Collision(links=pieces),
        }
    )
    loaded = model.compile_folder(build({"x": asset}))
    data = model.at_home(loaded)
    poses = kinematics.link_poses(body)
    for link, origin in (("lid", body.joints[0].origin), ("flap", slide.origin)):
        expected = asset.pose.matrix @ poses[link] @ transforms.rigid(np.eye(3), np.array(origin))
        found = data.body(f"x_{link}")
        np.testing.assert_allclose(found.xpos, expected[:3, 3], atol=1e-7)
        np.testing.assert_allclose(quaternions.to_matrix(found.xquat), expected[:3, :3], atol=1e-7)
    assert loaded.nexclude == 3


@pytest.mark.medium
def test_the_camera_projects_as_the_intrinsics_say() -> None:
    lens = factories.camera(400, 300)
    table = factories.support()
    places = [(-0.3, 0.1), (0.25, -0.2), (0.3, 0.3)]
    cubes = {
        f"cube_{i}": factories.box_asset(factories.pose(x, y), (0.02, 0.02, 0.02)) for i, (x, y) in enumerate(places)
    }
    loaded = model.compile_folder(twins.scene(cubes, lens=lens))
    data = model.at_home(loaded)
    with mujoco.Renderer(loaded, lens.height, lens.width) as renderer:
        renderer.update_scene(data, camera="capture")
        renderer.enable_segmentation_rendering()
        seen = renderer.render()[..., 0]
    for i, (x, y) in enumerate(places):
        geom = loaded.geom(f"cube_{i}_visual").id
        found = np.argwhere(seen == geom)[:, ::-1].mean(axis=0)
        middle = transforms.apply(transforms.invert(table.camera_pose.matrix), np.array([[x, y, 0.01]]))
        assert np.abs(found - cameras.project(middle, lens.matrix())[0]).max() < 0.6


def test_the_same_twin_gives_the_same_bytes_in_any_order(assets: dict[str, Asset]) -> None:
    again = dict(reversed(assets.items()))
    assert build(assets).files == build(again).files
    assert "/" not in build(assets).files["scene.xml"].decode().split("meshdir=")[1].split()[0]


def test_labels_become_safe_unique_names() -> None:
    labels = ["Blue Mug (2)", "blue-mug-2", "world", "2nd", "дом"]
    found = names.body_names(labels)
    assert len(set(found.values())) == len(labels)
    assert found["2nd"] == "object_2nd"
    assert found["world"] == "world_2"
    assert all(name.isascii() and name.replace("_", "a").isalnum() for name in found.values())


def test_a_link_name_never_takes_an_objects_name() -> None:
    found = names.link_names({"laptop": factories.laptop_asset(), "laptop_lid": factories.box_asset()})
    assert found["laptop_lid", "base"] == "laptop_lid"
    assert found["laptop", "lid"] == "laptop_lid_2"
    assert len(set(found.values())) == 3


@pytest.mark.parametrize("points", [np.zeros((4, 3)), np.eye(3), 1e-4 * np.eye(3)])
def test_degenerate_pieces_do_not_break_the_load(points: np.ndarray) -> None:
    box = factories.box_asset()
    hulls = (*box.collision.links["base"].hulls, Hull(vertices=points.astype(np.float32)))
    asset = box.model_copy(update={"collision": Collision(links={"base": Pieces(hulls=hulls, method="hull")})})
    assert model.compile_folder(build({"box": asset})).nmesh == 4


def test_an_empty_scene_loads() -> None:
    loaded = model.compile_folder(build({}))
    assert loaded.nbody == 1
    assert model.at_home(loaded).ncon == 0


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.6, 0.9])
def test_restitution_is_met_in_a_drop(restitution: float) -> None:
    box = factories.box_asset(factories.pose(z=0.05), (0.1, 0.1, 0.02), restitution=restitution)
    loaded = model.compile_folder(build({"box": box}))
    loaded.opt.timestep = 0.0005
    data = model.at_home(loaded)
    speeds = []
    for _ in range(600):
        mujoco.mj_step(loaded, data)
        speeds.append(float(data.qvel[2]))
    assert max(speeds) / -min(speeds) == pytest.approx(restitution, abs=0.03)


def test_restitution_is_nearly_met_at_the_step_of_tasks() -> None:
    """The step of 2 ms takes a little away, most from those that hardly bounce."""
    for restitution, lost in ((0.3, 0.06), (0.6, 0.04), (0.9, 0.02)):
        speeds, _ = dropped(restitution, None, 0.002)
        met = speeds.max() / -speeds.min()
        assert restitution - lost < met < restitution + 0.01


@pytest.mark.parametrize("stiffness", [1000.0, 5000.0])
def test_stiffness_is_met_in_the_time_of_an_impact(stiffness: float) -> None:
    """A spring under a mass is touched for half a period."""
    speeds, touching = dropped(0.9, stiffness, 0.0005)
    ends = np.flatnonzero(np.diff(touching.astype(int)))
    assert (ends[1] - ends[0]) * 0.0005 == pytest.approx(np.pi / np.sqrt(stiffness / 0.3), rel=0.06)
    assert speeds.max() / -speeds.min() == pytest.approx(0.9, abs=0.03)


def dropped(restitution: float, stiffness: float | None, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed and whether it touches of a box of 0.3 kg that falls by 5 cm, over 0.6 s."""
    box = factories.box_asset(factories.pose(z=0.05), (0.1, 0.1, 0.02), mass=0.3, restitution=restitution)
    physics = box.physics.model_copy(update={"stiffness_n_m": stiffness})
    loaded = model.compile_folder(build({"box": box.model_copy(update={"physics": physics})}))
    loaded.opt.timestep = step_s
    data = model.at_home(loaded)
    rows = []
    for _ in range(int(0.6 / step_s)):
        mujoco.mj_step(loaded, data)
        rows.append((data.qvel[2], any(contact.dist < 0 for contact in data.contact)))
    speeds, touching = (np.array(each) for each in zip(*rows, strict=True))
    return speeds, touching


@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_a_push_slides_when_it_beats_the_objects_own_friction(friction: float) -> None:
    box = factories.box_asset(size=(0.2, 0.2, 0.05), mass=1.0, friction=friction)
    loaded = model.compile_folder(build({"box": box}))
    for part, slides in ((0.8, False), (1.2, True)):
        data = model.at_home(loaded)
        data.xfrc_applied[1, 0] = part * friction * 9.81
        for _ in range(250):
            mujoco.mj_step(loaded, data)
        assert (abs(data.qpos[0]) > 0.02) == slides


def test_a_ball_dropped_into_the_bowl_stays_inside() -> None:
    folder = build({"bowl": factories.bowl_asset()})
    spec = mujoco.MjSpec.from_string(
        folder.files["scene.xml"].decode(),
        include=None,
        assets={name: data for name, data in folder.files.items() if name != "scene.xml"},
    )
    ball = spec.worldbody.add_body(name="ball", pos=[0.01, 0.0, 0.12])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.015, 0, 0], mass=0.01)
    spec.delete(spec.keys[0])
    loaded = spec.compile()
    data = mujoco.MjData(loaded)
    for _ in range(1500):
        mujoco.mj_step(loaded, data)
    assert data.body("ball").xpos[2] == pytest.approx(0.005 + 0.015, abs=0.003)


def test_the_lid_needs_more_than_its_weight_to_move() -> None:
    laptop = factories.laptop_asset(mass=1.3)
    dry, viscous = mjcf_contact.joint_friction(laptop.body.joints[0], laptop.body, laptop.physics)
    torque = 0.3 * 1.3 * 9.81 * np.hypot(0.11, 0.0195 - 0.0165)
    assert dry == pytest.approx(1.5 * torque + 0.001 * 0.3 * 1.3 * 9.81, rel=2e-3)
    assert 0 < viscous < dry


def test_the_texture_stands_upright_in_the_render() -> None:
    lens, table = factories.camera(), factories.support()
    loaded = model.compile_folder(twins.scene({}, lens=lens))
    pixels = rendering.render_rgb(loaded, model.at_home(loaded), lens, table.camera_pose.matrix).astype(int)
    near, far = pixels[-10, 160], pixels[90, 160]
    assert near[1] > far[1] + 10, "green grows towards the picture's lower border, which is the near side"
    assert pixels[-10, 220, 0] > pixels[-10, 100, 0] + 5, "red grows to the right"
