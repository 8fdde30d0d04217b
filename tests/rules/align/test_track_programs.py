"""Trackers that run as programs: what they are given, what is made of their answers, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.errors import RuleError
from dextera_build.geometry import poses, transforms
from dextera_build.testing import RuleRunner
from rules.align.track import symmetry
from tests import factories
from tests.benchmarks.tracking import scene
from tests.rules.align import films, trackers
from tests.rules.align.test_track import asset, support
from tests.rules.factorize.shapes import generators

COUNT = 4
SHIFT = np.array([0.2, 0.1, -0.3])
"""From the middle of the mesh to the origin of its frame [m]."""


def path(time: float) -> np.ndarray:
    return scene.standing(0.05 * time, 0.0, 20)


def shifted() -> Asset:
    """A box whose frame is not at its middle, placed where `path` has the box."""
    made = asset(path(0.0))
    link = made.body.links["base"]
    mesh = link.mesh.model_copy(update={"vertices": link.mesh.vertices + SHIFT.astype(np.float32)})
    body = made.body.model_copy(update={"links": {"base": link.model_copy(update={"mesh": mesh})}})
    back = np.eye(4)
    back[:3, 3] = -SHIFT
    pose = made.pose.model_copy(update={"matrix": made.pose.matrix @ back})
    return made.model_copy(update={"body": body, "pose": pose})


@pytest.fixture(scope="module")
def film() -> list[tuple[RgbdFrame, np.ndarray]]:
    mesh = asset(np.eye(4)).body.links["base"].mesh
    actors = {"box": scene.Actor({"base": mesh}, path)}
    return list(
        scene.frames(scene.Sequence("program", actors, lambda time: support(0.0).camera_pose.matrix, 0.4, 10.0))
    )


@pytest.fixture
def video(tmp_path: Path, film: list[tuple[RgbdFrame, np.ndarray]]) -> RgbdVideo:
    return RgbdVideo.write(tmp_path / "film.zip", scene.CAMERA, (frame for frame, _ in film))


def runner_of(tmp_path: Path, modules: dict[str, str]) -> RuleRunner:
    generators.environment(tmp_path, "foundation_pose", modules)
    (tmp_path / "scratch").mkdir()
    return RuleRunner(tmp_path / "scratch", project=tmp_path, gpu_gb=80.0)


def run(runner: RuleRunner, video: RgbdVideo, **more: object) -> Tracking:
    assets = Collection[Asset](items={"box": shifted()})
    given = {"video": video, "assets": assets, "support": support(0.0)} | more
    return runner.run("align.track", backend="foundation_pose", **given)


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_a_mesh_that_is_not_centred_is_tracked_in_metres(
    tmp_path: Path, video: RgbdVideo, film: list[tuple[RgbdFrame, np.ndarray]], masked: bool
):
    """Trap 23: FoundationPose works with a centred mesh, in metres, and compares the texture."""
    labels = ((each.astype(np.uint8), None) for _, each in film)
    more = {"masks": MaskTrack.of(("box",), video.stamps, labels)} if masked else {}
    track = run(runner_of(tmp_path, trackers.FOUNDATION_POSE), video, **more).tracks["box"]
    assert track.status == COUNT * ("tracked",)
    middle = np.array([0.0, 0.0, 0.06])
    for stamp, pose in zip(track.stamps, track.poses, strict=True):
        made = transforms.apply(poses.to_matrix(pose), (SHIFT + middle)[None])[0]
        assert made == pytest.approx(path(stamp)[:3, 3] + middle, abs=0.01)


@pytest.mark.slow
def test_a_pose_that_the_depth_contradicts_is_lost(tmp_path: Path, video: RgbdVideo):
    """The program itself gives no status: it always has a pose."""
    wrong = trackers.FOUNDATION_POSE["estimater.py"].replace(
        "return (self.pose_last @", "return (torch.tensor(np.eye(4) + np.eye(4, k=3) * 0.1).float() @ self.pose_last @"
    )
    track = run(runner_of(tmp_path, {**trackers.FOUNDATION_POSE, "estimater.py": wrong}), video).tracks["box"]
    assert set(track.status) == {"lost"}


@pytest.mark.slow
def test_an_answer_for_other_frames_is_refused(tmp_path: Path, video: RgbdVideo):
    short = trackers.FOUNDATION_POSE["estimater.py"].replace("reshape(4, 4)\n", "reshape(2, 8)[:1]\n")
    with pytest.raises(RuleError):
        run(runner_of(tmp_path, {**trackers.FOUNDATION_POSE, "estimater.py": short}), video)


def test_symmetries_are_told_by_the_shape():
    """Trap 23: round things need their turns, or the pose spins about the axis."""
    box = factories.box_asset(size=(0.1, 0.1, 0.2)).body.links["base"].mesh
    brick = factories.box_asset(size=(0.06, 0.16, 0.2)).body.links["base"].mesh
    bowl = factories.bowl_asset().body.links["base"].mesh
    assert [len(symmetry.turns(mesh.vertices, mesh.faces)) for mesh in (box, brick, bowl)] == [4, 2, symmetry.ROUND]


@pytest.mark.medium
def test_deaot_follows_labels_by_their_numbers(tmp_path: Path):
    """Trap 18: SAM-Track takes red first. Trap 23: its labels are uint8."""
    pytest.importorskip("av")
    shapes = [
        films.disc(1, (200, 40, 40), lambda n: (80.0 + 2 * n, 90.0, 0.0)),
        films.box(2, (40, 60, 220), lambda n: (180.0 - 2 * n, 100.0, 0.0)),
    ]
    video, labels = films.film(tmp_path / "film.mp4", 6, shapes)
    generators.environment(tmp_path, "deaot", trackers.DEAOT)
    (tmp_path / "scratch").mkdir()
    first = LabelImage(labels=labels[0].astype(np.int32))
    found: MaskTrack = RuleRunner(tmp_path / "scratch", project=tmp_path, gpu_gb=80.0).run(
        "align.follow", backend="deaot", video=video, first=first
    )
    for made, true in zip(found.every(), labels, strict=True):
        for label in (1, 2):
            assert ((made == label) & (true == label)).sum() > 0.5 * (true == label).sum()
