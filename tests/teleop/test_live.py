"""What a session checks before it opens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.errors import ArtifactError, UsageError
from dextera_build.teleop import live


def wanted(out: Path, **changes: Any) -> live.Wanted:
    # A session is refused before it reads its task.
    one = live.Wanted(None, out, 1, 0, (), 60.0, 1.0, "127.0.0.1", 0, None, (), True)  # type: ignore[arg-type]
    return replace(one, **changes)


def refused(asked: live.Wanted) -> UsageError:
    with pytest.raises(UsageError) as caught:
        live.run(asked, print)
    return caught.value


@pytest.mark.parametrize(
    "changes", [{"takes": 0}, {"limit_s": 0.0}, {"limit_s": np.inf}, {"limit_s": np.nan}, {"speed": np.nan}]
)
def test_numbers_that_no_session_has_are_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    assert refused(wanted(tmp_path / "made.mcap", **changes)).code == "DXB-U336"


def test_a_recording_that_exists_is_kept(tmp_path: Path) -> None:
    (tmp_path / "made.mcap").write_bytes(b"takes")
    error = refused(wanted(tmp_path / "made.mcap"))
    assert (error.code, (tmp_path / "made.mcap").read_bytes()) == ("DXB-U330", b"takes")
    assert refused(wanted(tmp_path / "made.bag")).code == "DXB-U335"


def test_a_folder_that_cannot_be_written_is_told_before_the_first_take(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    error = refused(wanted(tmp_path / "file" / "made.mcap"))
    assert (error.code, error.message) == ("DXB-U349", f"recordings cannot be written to `{tmp_path / 'file'}`")
    assert "--out" in (error.hint or "")


def test_starts_of_a_recording_that_is_not_there_are_told(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"`gone\.mcap` cannot be read as MCAP") as caught:
        HandStream.load(tmp_path / "gone.mcap")
    assert caught.value.facts == {"why": "there is no such file"}
