"""Masks through films whose true masks are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.image import LabelImage
from dextera_build.artifacts.mask_track import MaskTrack
from dextera_build.artifacts.video import Video
from dextera_build.artifacts.view import InstanceMap
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


def test_shapes_that_turn_hide_one_another_and_leave(tmp_path: Path) -> None:
    """The box passes behind the disc, which hides up to half of it, and leaves the picture on the left."""
    shapes = [
        films.disc(1, RED, lambda n: (70 + 1.4 * n, 90 + 8 * np.sin(n / 12), 0.6 * n)),
        films.box(2, BLUE, lambda n: (210.5 - 4.6 * n, 118.5, -1.0 * n)),
    ]
    video, true = films.film(tmp_path / "a.mp4", 60, shapes)
    found, line = run(tmp_path, video, true[0], names=["disc", "box"])
    shown = (true == 2).sum(axis=(1, 2))
    assert shown[23] < 0.5 * shown[0]
    assert not shown[53:].any()
    disc, box = (films.iou(maps(found), true, label) for label in (1, 2))
    assert disc.mean() > 0.95
    assert disc.min() > 0.9
    there = shown > 0.25 * shown[0]
    assert box[there].mean() > 0.9
    assert box[there].min() > 0.8
    last = int(np.flatnonzero(found.seen[:, 1]).max())
    assert 45 <= last <= 53
    assert not found.seen[last + 1 :, 1].any()
    assert line == f"2 objects through 60 frames; box not seen after {found.stamps[last]:.2f} s"
    assert found.scores is not None
    assert (found.scores[~found.seen] == 0).all()


def covered(folder: Path, most: float, dimming: float = 0.0) -> tuple[Video, np.ndarray]:
    """A disc that something unnamed covers up to a part, and shows again; it covers all of it with `most` 1."""
    disc = films.disc(3, RED, lambda n: (80 + 0.8 * n, 90.0, 0.4 * n))
    way = 62 * (1 - most) + 16
    hand = films.box(4, SKIN, lambda n: (80 + 0.8 * n + way + 2.2 * abs(n - 30), 90.0, 90.0))
    return films.film(folder / "a.mp4", 60, [disc], hand, dimming)


@pytest.mark.parametrize("dimming", [0.0, 0.4])
def test_what_a_hand_hid_shows_again(tmp_path: Path, dimming: float) -> None:
    video, true = covered(tmp_path, 0.4, dimming)
    found, _ = run(tmp_path, video, true[0])
    overlap = films.iou(maps(found), true, 1)
    print(overlap.round(2), (true == 1).sum((1, 2)))
    assert found.names == ("1",)


def test_nothing_is_invented_for_an_object_that_is_hidden(tmp_path: Path) -> None:
    """The disc shows again behind the box, but the flow has lost it, so its masks stay empty."""
    shapes = [
        films.disc(5, RED, lambda n: (128.0, 96.0, 0.0)),
        films.box(6, BLUE, lambda n: (215.5 - 3 * n, 96.5, 0.0)),
    ]
    video, true = films.film(tmp_path / "a.mp4", 60, shapes)
    found, _ = run(tmp_path, video, true[0])
    print(films.iou(maps(found), true, 2).round(2), (true == 2).sum((1, 2)), found.areas[:, 1])
