"""Photographs of a reference world: faults of the camera, determinism, and nothing of the truth in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.artifacts.scenes.world import World
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast
from dextera_build.testing import RuleRunner
from tests.rules.capture.cameras import CAMERA

WORLD: dict[str, Any] = {
    "camera": CAMERA,
    "objects": {
        "mug": {"kind": "mug", "at_m": (0.12, -0.1)},
        "carton": {"kind": "carton", "at_m": (-0.2, 0.1), "yaw_deg": 20.0},
    },
    "lamps": ({"direction": (0.3, 0.5, -1.0), "strength": 0.6, "shadow": True},),
}
BACKENDS = ("mujoco", "stub")


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    return RuleRunner(tmp_path_factory.mktemp("reference"))


@pytest.fixture(scope="module")
def world(runner: RuleRunner) -> World:
    made: World = runner.run("reference.world", options=WORLD)
    return made


@pytest.fixture(scope="module", params=BACKENDS)
def pair(runner: RuleRunner, world: World, request: pytest.FixtureRequest) -> tuple[Capture, Truth]:
    return (
        runner.run("reference.photograph", backend=request.param, world=world, options={"seed": 7}),
        runner.run("reference.truth", backend=request.param, world=world),
    )


@pytest.mark.medium
def test_a_capture_holds_nothing_but_pictures_and_intrinsics(pair: tuple[Capture, Truth], world: World) -> None:
    assert set(type(pair[0]).model_fields) == {"photograph", "measured"}
    assert set(type(pair[0].photograph).model_fields) == {"rgb", "camera", "gravity"}
    assert set(type(pair[0].measured).model_fields) == {"depth"}
    assert pair[0].photograph.gravity is None
    assert pair[0].photograph.camera == world.camera


@pytest.mark.medium
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_same_seed_gives_the_same_bytes(runner: RuleRunner, world: World, backend: str) -> None:
    shots = [runner.run("reference.photograph", backend=backend, world=world, options={"seed": s}) for s in (7, 7, 8)]
    digests = [runner.encode(shot) for shot in shots]
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.medium
def test_depth_is_counted_in_millimetres(pair: tuple[Capture, Truth]) -> None:
    counts = pair[0].measured.depth.depth.astype(np.float64) * 1000
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)


def test_depth_noise_grows_with_the_square_of_the_distance(pair: tuple[Capture, Truth]) -> None:
    capture, truth = pair
    seen, true = capture.measured.depth.depth, truth.depth.depth
    for low, high in ((0.75, 0.95), (2.2, 2.8)):
        here = (seen > 0) & (true > low) & (true < high)
        assert here.sum() > 500
        error = (seen - true)[here].astype(np.float64)
        model = np.sqrt((true[here].astype(np.float64) ** 4).mean()) * 0.05 / (640.0 * 0.05)
        assert error.std() == pytest.approx(model, rel=0.2)
        assert abs(error.mean()) < 0.15 * model


def test_depth_is_lost_along_edges_and_hardly_elsewhere(pair: tuple[Capture, Truth]) -> None:
    capture, truth = pair
    lost = capture.measured.depth.depth == 0
    step = np.abs(np.diff(truth.depth.depth, axis=1)) > 0.1
    assert lost[:, 1:][step].mean() > 0.8
    assert lost.mean() < 0.12
    flat = np.zeros_like(lost)
    flat[150:175, 100:220] = True  # table in front of everything
    assert lost[flat].mean() < 0.02


def test_corners_are_darker_than_the_middle_by_the_vignetting(runner: RuleRunner, world: World) -> None:
    shots = [
        runner.run("reference.photograph", backend="stub", world=world, options={"colour_noise": {"vignetting": v}})
        for v in (0.0, 0.4)
    ]
    corner = [float(shot.photograph.rgb.pixels[-8:, :8].mean()) for shot in shots]
    middle = [float(shot.photograph.rgb.pixels[86:94, 156:164].mean()) for shot in shots]
    assert corner[1] / corner[0] == pytest.approx(0.62, abs=0.04)
    assert middle[1] / middle[0] == pytest.approx(1.0, abs=0.02)


def test_truth_labels_what_the_rays_of_the_camera_hit(pair: tuple[Capture, Truth]) -> None:
    truth = pair[1]
    surfaces = [raycast.Surface(thing.mesh.vertices, thing.mesh.faces) for thing in truth.objects.values()]
    camera = truth.camera
    seen = raycast.render(surfaces, camera.matrix(), truth.camera_pose.matrix, camera.height, camera.width)
    for number, thing in enumerate(truth.objects.values()):
        cast, labelled = seen.index == number, truth.labels.labels == thing.label
        assert (cast & labelled).sum() / (cast | labelled).sum() > 0.97
        inside = cast & labelled
        assert np.median(np.abs(seen.depth - truth.depth.depth)[inside]) < 1e-3


@pytest.mark.medium
def test_a_robot_that_the_world_waits_for_must_come(runner: RuleRunner) -> None:
    standing = runner.run("reference.world", options=WORLD | {"robot": {"position_m": (0.6, 0.3, 0.0)}})
    with pytest.raises(RuleError, match="has a place for a robot, but none is given") as error:
        runner.run("reference.photograph", backend="mujoco", world=standing)
    assert error.value.hint == "add input `robot`"


@pytest.mark.medium
def test_a_hidden_object_is_refused(runner: RuleRunner, tmp_path: Path) -> None:
    behind = {
        "screen": {"kind": "carton", "at_m": (0.0, 0.0), "size_m": (0.3, 0.02, 0.2)},
        "mug": {"kind": "mug", "at_m": (0.0, 0.08), "height_m": 0.05},
    }
    world = runner.run("reference.world", options=WORLD | {"objects": behind})
    with pytest.raises(RuleError, match="`mug` is hidden from the camera"):
        runner.run("reference.truth", backend="stub", world=world)
