"""Comments and layout of a recipe say nothing; all else does."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.recipe.content import content


def digest(folder: Path, text: str) -> str | None:
    file = folder / "recipe.yaml"
    file.write_text(text)
    return content(file)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("a: 1", "# why\n\na:   1   # because\n", True),
        ("a: {b: 1, c: [x]}", "a:\n  b: 1\n  c:\n  - x\n", True),
        ("a: 1", "a: '1'", False),
        ("a: 1", "a: 1.0", False),
        ("a: 1", "a: !!str 1", False),
        ("a: 1\nb: 2", "b: 2\na: 1", False),
        ("a: [b, c]", "a: [[b], c]", False),
        ("a: [[b], c]", "a: [[b, c]]", False),
        ("a: &x 1\nb: *x", "a: 1\nb: 1", False),
    ],
)
def test_what_counts(tmp_path: Path, one: str, other: str, same: bool) -> None:
    assert (digest(tmp_path, one) == digest(tmp_path, other)) is same


@pytest.mark.parametrize("text", ["a: [", "a: b: c"])
def test_what_is_no_yaml_says_nothing(tmp_path: Path, text: str) -> None:
    assert digest(tmp_path, text) is None
    assert content(tmp_path / "gone.yaml") is None
