"""align.scene and align.apply on a painted room of known pose and scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image, LabelImage
from dextera_build.artifacts.scenes.scene_fit import AlignedScene, SceneFit
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.errors import RuleError
from dextera_build.gaussians import splatting
from dextera_build.geometry import metrics, transforms
from dextera_build.testing import RuleRunner
from tests import factories
from tests.installed import needs
from tests.rules.align import painted

cv2 = pytest.importorskip("cv2")
needs("open3d", "pycolmap")

FACTOR = 0.37
SMALL = {"widths": [160], "points": 1500}
"""Options for time."""
AWAY = painted.motion((3.0, -12.0, 2.0), (0.35, -0.1, 0.1))
"""T_room_camera of the new capture; the scene's own picture was taken from the origin."""


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


def scene() -> Mesh:
    return painted.scaled(painted.room(), FACTOR)


def off(found: SceneFit, pose: np.ndarray = AWAY, factor: float = FACTOR) -> tuple[float, float, float]:
    """Distance of the camera from where it is [mm], angle [deg], relative error of the scale."""
    back = transforms.invert(found.motion.matrix)
    turn = back[:3, :3].T @ pose[:3, :3]
    place = back[:3, 3] / (found.motion.scale * factor)
    angle = np.degrees(transforms.angle(turn))
    return 1000 * float(np.linalg.norm(place - pose[:3, 3])), float(angle), found.motion.scale * factor - 1


@pytest.mark.slow
def test_matches_of_the_scenes_own_image_begin_the_alignment(runner: RuleRunner) -> None:
    """That image has another resolution; with its matches, no picture of the scene is drawn to find the start."""
    lens = painted.CAMERA.scaled(0.75)
    small = cv2.resize(painted.capture(painted.room(), np.eye(4)).photograph.rgb.pixels, (lens.width, lens.height))
    image = Photograph(rgb=Image(pixels=small), camera=lens)
    shot = painted.capture(painted.room(), AWAY)
    matches = runner.run("align.matches", backend="sift", first=image.rgb, second=shot.photograph.rgb)
    given = {"image": image, "matches": matches}
    options = {**SMALL, "enough": 20}
    found = runner.run("align.scene", backend="sift", options=options, capture=shot, scene=scene(), **given)
    apart, angle, scale = off(found)
    assert apart < 5
    assert angle < 0.2
    assert abs(scale) < 0.005
    with pytest.raises(RuleError, match="are given together"):
        runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=scene(), matches=matches)


@pytest.mark.medium
def test_a_scene_of_unknown_scale_is_aligned(runner: RuleRunner) -> None:
    shot = painted.capture(painted.room(), AWAY)
    found: SceneFit = runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=scene())
    apart, angle, scale = off(found)
    assert apart < 5
    assert angle < 0.2
    assert abs(scale) < 0.005
    assert (found.motion.parent, found.motion.child, found.doubts) == ("camera", "world", ())
    spread = np.sqrt(np.diag(found.motion.covariance))
    assert 0.0001 < np.linalg.norm(spread[:3]) < 0.005
    assert runner.outcome.line.startswith("scale 2.7")


@pytest.mark.slow
def test_a_scene_of_one_gaussian_for_each_pixel_is_aligned_as_well(runner: RuleRunner) -> None:
    """In a small picture many of them lie in a pixel: it has to show their mean, not the nearest."""
    own, shot = painted.capture(painted.room(), np.eye(4)), painted.capture(painted.room(), AWAY)
    splats: Splats = runner.run("reference.pixels_as_splats", capture=own, options={"scale_factor": FACTOR})
    found: SceneFit = runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=splats)
    apart, angle, scale = off(found)
    assert apart < 5
    assert angle < 0.2
    assert abs(scale) < 0.005


@pytest.mark.medium
def test_it_does_not_matter_where_the_scene_has_its_origin(runner: RuleRunner) -> None:
    there = transforms.rigid(painted.rotation(np.array([0.3, 1.0, -2.0])), np.array([5.0, -3.0, 1.0]))
    given = scene()
    moved = given.model_copy(update={"vertices": transforms.apply(there, given.vertices).astype(np.float32)})
    taken = Pose(parent="world", child="camera", matrix=there)
    shot = painted.capture(painted.room(), AWAY)
    found = runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=moved, taken=taken)
    whole = found.motion.matrix.copy()
    whole[:3, 3] /= found.motion.scale
    again = whole @ there
    again[:3, 3] *= found.motion.scale
    back = found.model_copy(update={"motion": found.motion.model_copy(update={"matrix": again})})
    assert off(back)[0] < 5
    assert abs(off(back)[2]) < 0.005


@pytest.mark.medium
def test_gamma_and_a_moved_box_do_not_move_the_camera(runner: RuleRunner) -> None:
    shot = painted.capture(painted.room(0, (0.3, 0.0, 0.1)), AWAY)
    darker = 255 * (shot.photograph.rgb.pixels / 255.0) ** 1.6 * 0.8
    found = runner.run(
        "align.scene", backend="sift", options=SMALL, capture=painted.photographed(shot, darker), scene=scene()
    )
    assert off(found)[0] < 8
    assert abs(off(found)[2]) < 0.005


@pytest.mark.medium
def test_pixels_of_the_robot_do_not_count(runner: RuleRunner) -> None:
    """Trap 21: whatever is painted on the masked pixels, theta is the same."""
    shot = painted.capture(painted.room(), AWAY)
    mask = np.zeros((240, 320), np.int32)
    mask[60:200, 180:300] = 1
    robot = LabelImage(labels=mask)
    found = []
    for grey in (0, 255):
        pixels = shot.photograph.rgb.pixels.copy()
        pixels[mask > 0] = grey
        given = painted.photographed(shot, pixels)
        found.append(
            runner.run("align.scene", backend="sift", options=SMALL, capture=given, scene=scene(), robot=robot)
        )
    one, other = (each.motion.matrix for each in found)
    assert np.abs(one - other).max() < 2e-3
    assert off(found[0])[0] < 8


@pytest.mark.medium
@pytest.mark.parametrize(
    "fault", [*(pytest.param(each, marks=pytest.mark.slow) for each in ("blurred", "dark")), "elsewhere"]
)
def test_what_cannot_be_decided_is_refused_with_evidence(runner: RuleRunner, fault: str) -> None:
    shot = painted.capture(painted.room(seed=7 if fault == "elsewhere" else 0), AWAY)
    pixels = shot.photograph.rgb.pixels
    if fault == "blurred":
        shot = painted.photographed(shot, cv2.GaussianBlur(pixels, (0, 0), 9.0))
    if fault == "dark":
        shot = painted.photographed(shot, pixels * 0.02)
    with pytest.raises(RuleError, match=r"not (be aligned|found in the scene)") as refused:
        runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=scene())
    assert fault == "elsewhere" or fault in refused.value.facts
    assert refused.value.hint


def test_a_photograph_without_depth_is_refused(runner: RuleRunner) -> None:
    """Trap 22: only measured depth determines the scale."""
    shot = painted.capture(painted.room(), AWAY).model_copy(update={"measured": None})
    with pytest.raises(RuleError, match="the scale is not determined"):
        runner.run("align.scene", backend="sift", options=SMALL, capture=shot, scene=scene())


def test_the_stub_is_at_the_scenes_own_picture(runner: RuleRunner) -> None:
    shot = painted.capture(painted.room(), np.eye(4))
    found = runner.run("align.scene", backend="stub", capture=shot, scene=scene())
    assert np.array_equal(found.motion.matrix, np.eye(4))


def test_a_moved_scene_looks_the_same_from_the_moved_camera(runner: RuleRunner) -> None:
    """Golden test: Gaussians of degree 3 under pose and scale, at more than 45 dB; the mesh goes with them."""
    made = factories.gaussians(300)
    matrix = painted.motion((40.0, 115.0, -30.0), (0.4, -1.2, 2.0))
    motion = Similarity(parent="camera", child="scene", matrix=matrix, scale=2.7)
    mesh = Mesh(vertices=made.means[:3].astype(np.float32), faces=np.array([[0, 1, 2]], np.int32))
    moved: AlignedScene = runner.run("align.apply", motion=motion, splats=Splats.of(made, "scene"), mesh=mesh)
    assert moved.splats is not None
    assert moved.mesh is not None
    assert np.allclose(moved.mesh.vertices, moved.splats.means[:3], atol=1e-6)
    k, size = painted.CAMERA.matrix(), (240, 320)
    middle, reach = made.means.mean(axis=0), np.ptp(made.means, axis=0).max()
    eye = transforms.rigid(np.eye(3), middle - [0, 0, 1.5 * reach])
    there = matrix @ transforms.rigid(eye[:3, :3], 2.7 * eye[:3, 3])

    def shot(given: Splats, pose: np.ndarray) -> np.ndarray:
        return np.round(255 * splatting.render(given.gaussians, k, pose, size).clip(0, 1)).astype(np.uint8)

    before, after = shot(Splats.of(made, "scene"), eye), shot(moved.splats, there)
    lit = before.max(axis=-1) > 8
    assert lit.mean() > 0.05
    assert (metrics.psnr(before, after, lit) or 99.0) > 45
    # The naive version, which leaves the colours as they were, fails.
    naive = moved.splats.model_copy(update={"harmonics": made.harmonics.astype(np.float32)})
    assert (metrics.psnr(before, shot(naive, there), lit) or 99.0) < 40


def test_the_scale_comes_before_both_motions(runner: RuleRunner) -> None:
    """Trap 6: X_W = T_W_C T_C_G [s_G X_G, 1]."""
    matrix, camera = painted.motion((10.0, 20, 30), (1, 2, 3)), painted.motion((-5.0, 3, 60), (0.1, 0, 1))
    motion = Similarity(parent="camera", child="scene", matrix=matrix, scale=0.4)
    mesh = Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32))
    onto = Pose(parent="world", child="camera", matrix=camera)
    moved = runner.run("align.apply", motion=motion, mesh=mesh, onto=onto)
    assert np.allclose(moved.mesh.vertices, transforms.apply(camera @ matrix, 0.4 * np.eye(3)), atol=1e-6)
    assert moved.frame == "world"
