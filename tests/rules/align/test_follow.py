"""Masks through films whose true masks are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.objects.view import InstanceMap, Segmentation
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

cv2 = pytest.importorskip("cv2")
pytest.importorskip("av")

from tests.rules.align import films  # noqa: E402  # needs OpenCV

RED, BLUE, SKIN = (190, 90, 70), (70, 110, 190), (150, 130, 110)


def run(folder: Path, video: Video, labels: np.ndarray, backend: str = "flow", **options: Any) -> tuple[MaskTrack, str]:
    """The masks, and the line in the build log."""
    runner, first = RuleRunner(folder), LabelImage(labels=labels.astype(np.int32))
    found: MaskTrack = runner.run("align.follow", backend=backend, video=video, first=first, options=options)
    return found, runner.outcome.line


def maps(found: MaskTrack) -> np.ndarray:
    return np.stack(list(found.every()))


@pytest.mark.medium
def test_shapes_that_turn_hide_one_another_and_leave(tmp_path: Path) -> None:
    """The box passes behind the disc, which hides up to half of it, and leaves the picture on the left."""
    shapes = [
        films.disc(1, RED, lambda n: (70.5 + 1.4 * n, 90.5 + 8 * np.sin(n / 12), 0.6 * n)),
        films.box(2, BLUE, lambda n: (210.5 - 4.6 * n, 118.5, -1.0 * n)),
    ]
    video, true = films.film(tmp_path / "a.mp4", 60, shapes)
    found, line = run(tmp_path, video, true[0], names=["disc", "box"])
    shown = (true == 2).sum(axis=(1, 2))
    assert shown[23] < 0.5 * shown[0]
    assert not shown[53:].any()
    disc, box = (films.iou(maps(found), true, label) for label in (1, 2))
    assert disc.mean() > 0.98
    assert disc.min() > 0.96
    there = shown > 0.25 * shown[0]
    assert box[there].mean() > 0.95
    assert box[there].min() > 0.8
    last = int(np.flatnonzero(found.seen[:, 1]).max())
    assert 45 <= last <= 53
    assert not found.seen[last + 1 :, 1].any()
    assert line == f"2 objects through 60 frames; box not seen after {found.stamps[last]:.2f} s"
    assert found.scores is not None
    assert (found.scores[~found.seen] == 0).all()


def covered(folder: Path, dimming: float) -> tuple[Video, np.ndarray]:
    """A disc that something unnamed covers up to 2/5, and shows again."""
    disc = films.disc(3, RED, lambda n: (80.5 + 0.8 * n, 90.5, 0.4 * n))
    hand = films.box(4, SKIN, lambda n: (106 + 0.8 * n + 2.2 * abs(n - 30), 90.0, 90.0))
    return films.film(folder / "a.mp4", 60, [disc], hand, dimming)


@pytest.mark.slow
@pytest.mark.parametrize("dimming", [pytest.param(0.0, marks=pytest.mark.slow), 0.4])
def test_what_a_hand_hid_shows_again(tmp_path: Path, dimming: float) -> None:
    video, true = covered(tmp_path, dimming)
    shown = (true == 1).sum(axis=(1, 2))
    assert shown[30] < 0.7 * shown[0]
    found, line = run(tmp_path, video, true[0])
    overlap = films.iou(maps(found), true, 1)
    assert overlap.mean() > 0.96
    assert overlap.min() > 0.87
    assert overlap[-10:].min() > 0.95
    assert (found.names, line) == (("1",), "1 object through 60 frames")


@pytest.mark.medium
def test_nothing_is_invented_for_an_object_that_was_hidden(tmp_path: Path) -> None:
    """The box shows again on the other side of the disc, but it has been lost, so its masks stay empty."""
    shapes = [
        films.disc(5, RED, lambda n: (128.5, 96.5, 0.0)),
        films.box(6, BLUE, lambda n: (215.5 - 3 * n, 96.5, 0.0)),
    ]
    video, true = films.film(tmp_path / "a.mp4", 50, shapes)
    found, _ = run(tmp_path, video, true[0])
    shown = (true == 2).sum(axis=(1, 2))
    assert shown.min() < 0.05 * shown[0] < 0.5 * shown[0] < shown[-1]
    disc, box = (films.iou(maps(found), true, label) for label in (1, 2))
    assert disc.min() > 0.9
    assert box[shown > 0.25 * shown[0]][:20].min() > 0.75
    assert not found.areas[31:, 1].any()


@pytest.mark.slow
def test_a_film_gives_the_same_masks_again(tmp_path: Path) -> None:
    video, true = covered(tmp_path, 0.0)
    first, second = (run(tmp_path / name, video, true[0])[0] for name in "ab")
    assert first.file == second.file


def test_an_object_without_pixels_is_never_seen(tmp_path: Path) -> None:
    video, true = films.film(tmp_path / "a.mp4", 3, [films.disc(7, RED, lambda n: (80.5, 90.5, 0.0))])
    found, line = run(tmp_path, video, 2 * true[0])
    assert found.areas[:, 0].tolist() == [0, 0, 0]
    assert found.areas[:, 1].min() > 0
    assert line == "2 objects through 3 frames; 1 never seen"


def still(folder: Path) -> tuple[Video, np.ndarray]:
    """Two frames in which nothing moves."""
    return films.film(folder / "a.mp4", 2, [films.box(8, BLUE, lambda n: (60.5, 70.5, 0.0))])


@pytest.mark.medium
def test_the_label_map_of_a_twin_is_a_first_frame(tmp_path: Path) -> None:
    video, true = still(tmp_path)
    first = InstanceMap(labels=true[0].astype(np.int32), fixed=np.zeros(true[0].shape, bool))
    inputs: dict[str, Any] = {"video": video, "first": first}
    found = RuleRunner(tmp_path).run("align.follow", backend="stub", options={"names": ["box"]}, **inputs)
    assert found.names == ("box",)
    assert np.array_equal(maps(found), true[[0, 0]])
    inputs["first"] = Segmentation(items={}, names=("crate",), map=first)
    assert RuleRunner(tmp_path).run("align.follow", backend="stub", **inputs).names == ("crate",)
    with pytest.raises(RuleError, match="the segmentation has names already"):
        RuleRunner(tmp_path).run("align.follow", backend="stub", options={"names": ["box"]}, **inputs)


@pytest.mark.parametrize(
    ("labels", "names", "why"),
    [
        (np.zeros((9, 9)), [], "the label map has no objects that can be followed"),
        (np.full((9, 9), 256), [], "the label map has no objects that can be followed"),
        (np.full((9, 9), -1), [], "the label map has no objects that can be followed"),
        (np.full((9, 9), 2), ["a"], "the names are not those of the labels"),
        (np.full((9, 9), 2), ["a", "a"], "the names are not those of the labels"),
        (np.full((9, 9), 2), [], "the label map is not of the size of the video"),
    ],
)
def test_a_label_map_that_does_not_fit_is_refused(tmp_path: Path, labels: Any, names: list[str], why: str) -> None:
    with pytest.raises(RuleError, match=why) as caught:
        run(tmp_path, still(tmp_path)[0], labels, backend="stub", names=names)
    assert caught.value.hint


@pytest.mark.medium
def test_an_rgbd_video_is_followed_from_a_frame_in_its_middle_in_both_directions(tmp_path: Path) -> None:
    shapes = [films.box(2, BLUE, lambda n: (60.5 + 8.0 * n, 118.5, 3.0 * n))]
    video, true = films.film(tmp_path / "a.mp4", 9, shapes)
    camera = Camera(width=video.width, height=video.height, fx=200.0, fy=200.0, cx=127.5, cy=95.5)
    depth, stamps = np.ones((video.height, video.width), np.float32), 5.0 + np.arange(9) / 10
    rgbd = RgbdVideo.write(
        tmp_path / "a.zip",
        camera,
        (RgbdFrame(float(t), rgb, depth) for t, rgb in zip(stamps, video.every(), strict=True)),
    )
    runner, first = RuleRunner(tmp_path), LabelImage(labels=true[4].astype(np.int32))
    found: MaskTrack = runner.run("align.follow", video=rgbd, first=first, options={"frame": 4})
    assert np.array_equal(found.stamps, stamps)
    assert films.iou(maps(found), true, 1).min() > 0.93
    assert found.first == 4
    with pytest.raises(RuleError, match="the video has no frame 9"):
        runner.run("align.follow", video=rgbd, first=first, options={"frame": 9})
