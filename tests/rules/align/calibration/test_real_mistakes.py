"""align.hand_eye names mistakes in the poses of photographs of a real robot; skipped where these are absent."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.benchmarks.calibration import mistakes


@pytest.mark.slow
@pytest.mark.parametrize("name", mistakes.MISTAKES)
@pytest.mark.parametrize("capture", mistakes.CAPTURES)
def test_a_mistake_in_the_poses_is_named(capture: str, name: str, tmp_path: Path) -> None:
    with pytest.raises(RuleError) as caught:
        RuleRunner(tmp_path).run("align.hand_eye", views=mistakes.wrong(capture, name))
    assert mistakes.MISTAKES[name].said in caught.value.message
