"""HY-Pano 2.0 and WorldMirror 2.0: the real programs, with stand-ins for the modules of their repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.scenes.room import Room
from dextera_build.errors import MachineError, RuleError
from dextera_build.geometry import cameras, transforms
from dextera_build.recipe import profiles
from dextera_build.testing import RuleRunner
from rules.background.room.alignment import between
from rules.background.room.sphere import level
from tests.rules.background.room import hy_world, world
from tests.rules.background.room.world import LENS, TABLE
from tests.rules.factorize.shapes import generators

POSE = TABLE.camera_pose.matrix
SCENE = world.background()


def runner(folder: Path, name: str, gpu_gb: float = 80.0) -> RuleRunner:
    generators.environment(folder, name, hy_world.MODULES[name])
    weights = {}
    for model, files in hy_world.WEIGHTS[name].items():
        weights[model] = folder / "weights" / model
        for file in files:
            path = weights[model] / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(file)
    (folder / "scratch").mkdir(exist_ok=True)
    return RuleRunner(folder / "scratch", project=folder, weights=weights, gpu_gb=gpu_gb)


def widened(folder: Path) -> Panorama:
    made: Panorama = runner(folder, "hy_pano").run(
        "background.panorama", backend="hy_pano", background=SCENE, camera=LENS, support=TABLE
    )
    return made


def downwards() -> float:
    """Angle of the photograph's axis below the horizon [deg]."""
    return float(np.degrees(np.arcsin(-POSE[2, 2])))


@pytest.mark.slow
@pytest.mark.parametrize("lower", [0.0, 12.5])
def test_the_photograph_is_found_in_the_generated_panorama(tmp_path: Path, monkeypatch, lower: float) -> None:
    """Level, as assumed, and painted lower than it is: then the pose of the panorama is not level."""
    monkeypatch.setenv("DXB_TEST_PITCH", str(downwards() + lower))
    panorama = widened(tmp_path)
    assert panorama.image.pixels.shape == (960, 1920, 3)
    turn = Rotation.from_euler("x", -(downwards() + lower), degrees=True).as_matrix()
    wanted = POSE[:3, :3] @ turn.T
    assert np.degrees(transforms.angle(panorama.pose.matrix[:3, :3] @ wanted.T)) < 0.6
    assert np.allclose(panorama.pose.matrix[:3, 3], POSE[:3, 3])
    if lower == 0.0:
        assert np.degrees(transforms.angle(panorama.pose.matrix[:3, :3] @ level(POSE).T)) < 0.6
    assert panorama.seen is not None
    assert 0.03 < panorama.seen.mean() < 0.07
    # Seen pixels show the table where it is.
    rows, columns = np.nonzero(panorama.seen)
    rays = panorama.lens().unproject(np.stack([columns, rows], axis=1).astype(float)) @ panorama.pose.matrix[:3, :3].T
    down = rays[:, 2] < -0.4
    spots = POSE[:2, 3] - rays[down, :2] / rays[down, 2:] * POSE[2, 3]
    errors = np.abs(panorama.image.pixels[rows[down], columns[down]] - world.pattern(spots)).max(axis=1)
    assert np.quantile(errors, 0.9) < 25


@pytest.mark.slow
def test_a_panorama_that_does_not_show_the_photograph_marks_nothing(tmp_path: Path) -> None:
    panorama = widened(tmp_path)
    assert panorama.seen is None
    assert np.allclose(panorama.pose.matrix[:3, :3], level(POSE))


def views(count: int = 5) -> Views:
    places = [(0.2 * n - 0.4, -0.9, 0.7 + 0.05 * (n % 2)) for n in range(count)]
    pixels = [np.full((LENS.height, LENS.width, 3), 40 * n, np.uint8) for n in range(count)]
    names = tuple(f"arc/{n}.png" for n in reversed(range(count)))
    return Views(
        images={name: encoded(each) for name, each in zip(names, pixels, strict=True)},
        names=names,
        camera=("1",) * count,
        cameras={"1": LENS},
        poses=np.array([cameras.look_at(np.array(place), np.zeros(3)) for place in places]),
    )


def composed(folder: Path, given: Views) -> Room:
    made: Room = runner(folder, "worldmirror").run(
        "background.compose", backend="worldmirror", views=given, background=SCENE
    )
    return made


@pytest.mark.parametrize("mode", ["", "logits"])
def test_the_answer_is_brought_back_into_the_world_in_metres(tmp_path: Path, monkeypatch, mode: str) -> None:
    monkeypatch.setenv("DXB_TEST_MIRROR", mode)
    given = views()
    room = composed(tmp_path, given)
    ahead = given.poses[:, :3, 3] + given.poses[:, :3, 2]
    assert np.allclose(room.splats.means, ahead, atol=1e-5)
    assert np.allclose(room.points.points, ahead, atol=1e-5)
    assert np.allclose(room.splats.scales, 0.01, rtol=1e-4)
    assert np.allclose(room.splats.opacities, np.linspace(0.1, 0.9, 5), atol=1e-5)
    assert (room.splats.frame, room.points.frame) == ("world", "world")
    assert sorted(room.depth) == sorted(given.names)
    for image in room.depth.values():
        assert image.depth.shape == (LENS.height, LENS.width)
        assert np.allclose(image.depth, 1.0, atol=1e-5)


def test_an_answer_with_other_cameras_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("DXB_TEST_MIRROR", "lost")
    with pytest.raises(RuleError, match="did not keep to the given cameras"):
        composed(tmp_path, views())


def test_views_from_one_place_give_no_scale(tmp_path: Path) -> None:
    given = views()
    poses = given.poses.copy()
    poses[:, :3, 3] = poses[0, :3, 3]
    with pytest.raises(RuleError, match="all cameras are at one place"):
        composed(tmp_path, given.model_copy(update={"poses": poses}))


def test_skipped_pictures_are_told(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("DXB_TEST_MIRROR", "skip")
    with pytest.raises(RuleError) as caught:
        composed(tmp_path, views())
    assert caught.value.code == "DXB-B370"


def test_a_panorama_among_the_views_is_refused(tmp_path: Path) -> None:
    lens = Panorama(image=SCENE.image.model_copy(), pose=TABLE.camera_pose).lens()
    given = views().model_copy(update={"cameras": {"1": lens}})
    with pytest.raises(RuleError, match="takes pictures of pinhole cameras"):
        composed(tmp_path, given)


@pytest.mark.parametrize(
    ("name", "rule", "given"),
    [
        ("hy_pano", "background.panorama", {"background": SCENE, "camera": LENS, "support": TABLE}),
        ("worldmirror", "background.compose", {"views": views()}),
    ],
)
def test_what_the_machine_lacks_is_told_with_the_next_step(tmp_path: Path, name: str, rule: str, given) -> None:
    with pytest.raises(MachineError) as caught:
        RuleRunner(tmp_path, gpu_gb=8.0).run(rule, backend=name, **given)
    needs = str(caught.value.facts["needs"])
    assert "a GPU with" in needs
    assert f".envs/{name}" in needs
    assert "weights" in needs


def test_poses_on_one_line_are_aligned_by_their_rotations() -> None:
    random = np.random.default_rng(3)
    source = np.tile(np.eye(4), (4, 1, 1))
    source[:, :3, :3] = Rotation.random(4, rng=random).as_matrix()
    source[:, :3, 3] = np.outer(np.arange(4), (1.0, 2.0, 0.5))
    truth = transforms.rigid(Rotation.from_rotvec((0.4, -1.2, 0.9)).as_matrix(), np.array([0.3, -0.2, 1.1]))
    target = truth @ source
    target[:, :3, 3] = transforms.apply(truth, 2.5 * source[:, :3, 3])
    scale, motion, misfit = between(source, target)
    assert scale == pytest.approx(2.5)
    assert np.allclose(motion, truth)
    assert misfit < 1e-9


def test_the_profile_gpu_prefers_the_models() -> None:
    listed = profiles.read("gpu", None).lists
    assert listed["background.panorama"] == ("hy_pano", "frustum")
    assert listed["background.compose"] == ("worldmirror", "points")
