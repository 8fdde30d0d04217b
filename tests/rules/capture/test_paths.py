"""capture.trajectory and capture.track: what is exported can be an input again."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.track import Track
from dextera_build.testing import RuleRunner
from tests.artifacts.test_forms import same
from tests.artifacts.test_track import GOOD
from tests.artifacts.test_trajectory import turning


def test_a_trajectory_is_read(tmp_path):
    turning(covariances=True).save(tmp_path / "path.txt")
    runner = RuleRunner(tmp_path)
    found = runner.run("capture.trajectory", file=File.of(tmp_path / "path.txt"))
    assert same(found, turning(covariances=True))
    named = runner.run("capture.trajectory", options={"child": "hand"}, file=File.of(tmp_path / "path.txt"))
    assert (named.parent, named.child) == ("world", "hand")


def test_a_track_is_read(tmp_path):
    track = Track(**GOOD)
    track.save(tmp_path / "track.csv")
    assert same(RuleRunner(tmp_path).run("capture.track", file=File.of(tmp_path / "track.csv")), track)
