"""Captures: what is written can be read again."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.testing import RuleRunner
from tests import factories


def test_an_exported_capture_is_read_back_as_it_was(tmp_path):
    random = np.random.default_rng(1)
    depth = (random.integers(500, 1500, (6, 8)) * 0.001).astype(np.float32)
    pixels = random.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    whole = factories.rgbd(pixels, depth, Camera(width=8, height=6, fx=7.5, fy=7.25, cx=3.5, cy=2.5))
    for number, capture in enumerate((whole, Capture(photograph=whole.photograph))):
        written = capture.export(tmp_path / f"out{number}", "capture")
        folder = Folder(files={path.name: path.read_bytes() for path in written})
        back = RuleRunner(tmp_path).run("capture.folder", folder=folder)
        assert (back.photograph.rgb.pixels == pixels).all()
        assert back.photograph.camera == whole.photograph.camera
        assert (back.measured is None) == (capture.measured is None)
        if back.measured is not None:
            assert np.allclose(back.measured.depth.depth, depth, atol=1e-6)
