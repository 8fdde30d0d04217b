"""Masks of `align.follow` through a sequence, from the true ones of its first frame."""

from __future__ import annotations

from collections.abc import Sequence as Rows
from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.testing import RuleRunner
from tests.benchmarks.tracking.scene import CAMERA, Sequence


def masks(folder: Path, sequence: Sequence, film: Rows[tuple[RgbdFrame, np.ndarray]]) -> MaskTrack:
    """Masks of all actors in the order of the sequence."""
    video = RgbdVideo.write(folder / "film.zip", CAMERA, (frame for frame, _ in film), depth_scale_m=0.0001)
    labels = np.where(film[0][1] <= len(sequence.actors), film[0][1], 0).astype(np.int32)
    found: MaskTrack = RuleRunner(folder).run(
        "align.follow", video=video, first=LabelImage(labels=labels), options={"names": list(sequence.actors)}
    )
    return found
