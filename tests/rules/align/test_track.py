"""align.track: objects through an RGB-D video, from where their assets were placed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.testing import RuleRunner
from tests import factories
from tests.benchmarks.tracking import scene

RATE, COUNT = 10.0, 7
LENS = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)


def path(time: float) -> np.ndarray:
    return scene.standing(-0.1 + 0.12 * time, 0.0, 15 + 20 * time)


def camera(time: float) -> np.ndarray:
    return scene.before(heading_deg=12 * time)


def asset(at: np.ndarray) -> Asset:
    return factories.box_asset(at, (0.06, 0.09, 0.12))


def support(time: float) -> Support:
    placed = Pose(parent="world", child="camera", matrix=camera(time))
    return Support(camera_pose=placed, polygon=np.array([(-1.0, -1), (1, -1), (1, 1)]))


@pytest.fixture(scope="module")
def film() -> list[tuple[RgbdFrame, np.ndarray]]:
    mesh = asset(np.eye(4)).body.links["base"].mesh
    made = scene.Sequence("rule", {"box": scene.Actor({"base": mesh}, path)}, camera, COUNT / RATE, RATE, LENS)
    return list(scene.frames(made))


@pytest.fixture
def video(tmp_path: Path, film: list[tuple[RgbdFrame, np.ndarray]]) -> RgbdVideo:
    posed = (RgbdFrame(f.stamp, f.rgb, f.depth, camera(f.stamp)) for f, _ in film)
    return RgbdVideo.write(tmp_path / "film.zip", LENS, posed)


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    (tmp_path / "scratch").mkdir()
    return RuleRunner(tmp_path / "scratch")


def run(runner: RuleRunner, video: RgbdVideo, first: int = 0, motion: str = "stated", **more: object) -> Tracking:
    backend = str(more.pop("backend", "model"))
    time = first / RATE
    given = {"assets": Collection[Asset](items={"box": asset(path(time))}), "support": support(time)} | more
    options = {"first": first, "camera": motion}
    return runner.run("align.track", backend=backend, video=video, options=options, **given)


@pytest.mark.parametrize("first", [0, 3])
def test_poses_are_in_the_world_of_the_assets_before_and_after_the_first_frame(
    runner: RuleRunner, video: RgbdVideo, first: int
):
    track = run(runner, video, first).tracks["box"]
    assert (track.parent, track.child) == ("world", "box")
    assert track.status == COUNT * ("tracked",)
    for stamp, pose in zip(track.stamps, track.poses, strict=True):
        assert pose[:3] == pytest.approx(path(stamp)[:3, 3], abs=0.004)
        turn = poses.to_matrix(pose)[:3, :3] @ path(stamp)[:3, :3].T
        assert np.degrees(transforms.angle(turn)) < 2
    assert track.covariances is not None
    assert (np.sqrt(track.covariances[:, 0, 0]) < 0.01).all()
    assert runner.outcome.line == f"tracked in {COUNT} frames: box {COUNT}"


def test_without_the_motion_of_the_camera_poses_are_in_its_frame(runner: RuleRunner, video: RgbdVideo):
    track = run(runner, video, motion="unknown").tracks["box"]
    assert track.parent == "camera"
    for stamp, pose in zip(track.stamps, track.poses, strict=True):
        true = transforms.invert(camera(stamp)) @ path(stamp)
        assert pose[:3] == pytest.approx(true[:3, 3], abs=0.004)


def test_a_camera_that_is_said_to_stand_and_moves_gives_poses_that_move(runner: RuleRunner, video: RgbdVideo):
    """What is stated about the camera enters the answer: it is not checked against the picture."""
    track = run(runner, video, motion="stands").tracks["box"]
    turn = poses.to_matrix(track.poses[-1])[:3, :3] @ path(track.stamps[-1])[:3, :3].T
    assert np.degrees(transforms.angle(turn)) > 4


def test_masks_are_taken_by_name(runner: RuleRunner, video: RgbdVideo, film: list[tuple[RgbdFrame, np.ndarray]]):
    labels = ((each.astype(np.uint8), None) for _, each in film)
    masks = MaskTrack.of(("box",), video.stamps, labels)
    assert run(runner, video, masks=masks).tracks["box"].status == COUNT * ("tracked",)
    late = MaskTrack.of(("box",), video.stamps + 1, ((each.astype(np.uint8), None) for _, each in film))
    with pytest.raises(RuleError, match="not those of this video"):
        run(runner, video, masks=late)


def test_the_first_frame_is_that_of_the_masks(
    runner: RuleRunner, video: RgbdVideo, film: list[tuple[RgbdFrame, np.ndarray]]
):
    """Stated to two rules, the number was once given to one, and the masks were those of another frame."""
    masks = MaskTrack.of(("box",), video.stamps, ((each.astype(np.uint8), None) for _, each in film), first=3)
    time = 3 / RATE
    given = {"assets": Collection[Asset](items={"box": asset(path(time))}), "support": support(time), "masks": masks}
    found: Tracking = runner.run("align.track", video=video, options={"camera": "stated"}, **given)
    assert found.tracks["box"].poses[3, :3] == pytest.approx(path(time)[:3, 3], abs=0.004)
    with pytest.raises(RuleError, match="the masks were given in another frame") as caught:
        run(runner, video, 2, masks=masks)
    assert caught.value.facts == {"first": "2", "masks": "given in frame 3"}


def test_a_mesh_in_millimetres_is_refused(runner: RuleRunner, video: RgbdVideo):
    """Trap 23: trackers fail in silence on meshes that are not in metres."""
    large = factories.box_asset(path(0.0), (60.0, 90.0, 120.0))
    with pytest.raises(RuleError, match="hardly in metres"):
        run(runner, video, assets=Collection[Asset](items={"box": large}))
    unknown = asset(path(0.0)).model_copy(update={"scale": "unknown"})
    with pytest.raises(RuleError, match="hardly in metres"):
        run(runner, video, assets=Collection[Asset](items={"box": unknown}))


def test_a_frame_or_a_motion_that_is_not_there_is_refused(runner: RuleRunner, video: RgbdVideo):
    with pytest.raises(RuleError, match="no frame 99"):
        run(runner, video, 99)
    with pytest.raises(RuleError, match="does not state how its camera moves"):
        run(runner, video.model_copy(update={"poses": None}))


def test_the_stub_says_that_it_measures_nothing(runner: RuleRunner, video: RgbdVideo):
    track = run(runner, video, motion="stands", backend="stub").tracks["box"]
    assert set(track.status) == {"predicted"}
    assert track.poses[-1, :3] == pytest.approx(path(0.0)[:3, 3])


def test_tracks_of_different_frames_make_no_tracking(runner: RuleRunner, video: RgbdVideo):
    one = run(runner, video, backend="stub", motion="stands").tracks["box"]
    with pytest.raises(ArtifactError, match="differ in frame"):
        Tracking(tracks={"a": one, "b": one.model_copy(update={"parent": "camera"})})
