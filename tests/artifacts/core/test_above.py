"""What values offer and rooms above them do: in no key, and refused where a result could depend on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.core import above
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.code.loader import PACKAGE, Library
from dextera_build.errors import RuleError

CLOUD = PointCloud(points=np.eye(3, dtype=np.float32))


def test_no_type_brings_a_format_or_a_preview_into_a_key(tmp_path: Path) -> None:
    types = sorted((PACKAGE / "artifacts").rglob("[!_]*.py"))
    held = Library(tmp_path).code.of(*types).definitions
    assert "dextera_build/artifacts/core/above.py" in held
    assert [name for name in held if name.startswith(("dextera_build/formats/", "dextera_build/previews/"))] == []


@pytest.mark.parametrize(
    ("asked", "ask"),
    [
        ("PointCloud.save", lambda folder: CLOUD.save(folder / "a.ply")),
        ("PointCloud.load", lambda folder: PointCloud.load(folder / "a.ply")),
        ("PointCloud.export", lambda folder: CLOUD.export(folder, "a")),
        ("PointCloud.picture", lambda _: CLOUD.picture()),
        ("PointCloud._repr_html_", lambda _: CLOUD._repr_html_()),
    ],
)
def test_a_rule_is_refused_what_its_key_does_not_hold(tmp_path: Path, asked, ask) -> None:
    CLOUD.save(tmp_path / "a.ply")
    with above.refused(), pytest.raises(RuleError, match=rf"a rule called `{asked}`") as caught:
        ask(tmp_path)
    assert caught.value.code == "DXB-B387"
    ask(tmp_path)


def test_a_rule_may_ask_for_text() -> None:
    with above.refused():
        assert next(CLOUD.facts()) == "3 points"
        assert repr(CLOUD).startswith("PointCloud(3 points")
