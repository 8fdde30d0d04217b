"""benchmark.source_yields: attempts are counted by the demonstration and the segment that they ended in."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.tasks.episode import Episode, Episodes, Segment
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import episodes


def attempt(source: str, last: str, reason: str) -> Episode:
    """An attempt that ended in segment `last`."""
    segments = (
        Segment(name="approach", first=0, last=3, frame="", contact=False),
        Segment(name=last, first=3, last=6, frame="box", contact=True),
    )
    changed = {"sources": (source, "9"), "segments": segments, "success": not reason, "reason": reason}
    return episodes.episode(6).model_copy(update=changed)


def made() -> Episodes:
    kept = {"0": attempt("2", "lift", ""), "1": attempt("2", "lift", ""), "2": attempt("10", "lift", "")}
    lost = {
        "0-1": attempt("2", "grasp", "touched `table` in `grasp`"),
        "0-2": attempt("10", "grasp", "slipped"),
        "0-3": attempt("10", "lift", "slipped"),
    }
    return episodes.small(1, 6).model_copy(update={"items": kept, "failures": lost, "attempts": 6})


def test_attempts_are_counted_by_demonstration_and_segment(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    table = runner.run("benchmark.source_yields", episodes=made())
    names = [column.name for column in table.columns]
    rows = {str(row[0]): dict(zip(names, row, strict=True)) for row in table.rows}
    assert list(rows) == ["2", "10", "all"]
    assert [rows["2"][name] for name in ("attempts", "kept", "lost in grasp", "lost in lift")] == [3, 2, 1, 0]
    assert [rows["10"][name] for name in ("attempts", "kept", "lost in grasp", "lost in lift")] == [3, 1, 1, 1]
    assert rows["all"]["yield"] == 50.0
    assert "2 x slipped" in table.notes[1]
    ((caption, picture),) = runner.outcome.previews
    pixels = np.array(Image.open(io.BytesIO(picture)))
    kept = (pixels == (58, 110, 165)).all(axis=-1).sum(axis=1)
    # Two of three bars' parts were kept in the first row, one in the second.
    assert kept[22:44].max() == pytest.approx(2 * kept[44:66].max(), rel=0.02)
    assert "kept" in caption


def test_no_attempt_is_refused(tmp_path: Path) -> None:
    nothing = made().model_copy(update={"items": {}, "failures": {}, "attempts": 0})
    with pytest.raises(RuleError, match="there are no episodes"):
        RuleRunner(tmp_path).run("benchmark.source_yields", episodes=nothing)
