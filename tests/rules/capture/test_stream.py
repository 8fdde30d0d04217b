"""capture.stream: recordings are inputs, and go through the store as they are."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.stream import Stream
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.artifacts.test_stream import JOINTS


def test_a_recording_is_opened(tmp_path):
    Stream.record(tmp_path / "a.mcap", joints={"/joint_states": JOINTS})
    runner, file = RuleRunner(tmp_path), File.of(tmp_path / "a.mcap")
    found = runner.run("capture.stream", options={"topics": ["/joint_states"]}, file=file)
    assert (found.joints("/joint_states").positions == JOINTS.positions).all()
    with pytest.raises(RuleError, match="topic `/camera` was not recorded"):
        runner.run("capture.stream", options={"topics": ["/camera"]}, file=file)
