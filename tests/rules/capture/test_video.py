"""capture.video: frames of a stored video are those of the file."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.video import Video, encoder
from dextera_build.errors import ArtifactError
from dextera_build.testing import RuleRunner
from tests.artifacts.test_video import pixels, shown


def test_a_video_is_opened(tmp_path):
    Video.write(tmp_path / "a.mp4", map(pixels, range(12)), encoder(64, 32, 30.0))
    found = RuleRunner(tmp_path).run("capture.video", file=File.of(tmp_path / "a.mp4"))
    assert [shown(frame) for frame in found.frames([11, 4])] == [11, 4]


def test_another_file_is_refused(tmp_path):
    with pytest.raises(ArtifactError, match="cannot be read as a video"):
        RuleRunner(tmp_path).run("capture.video", file=File(data=b"no video"))
