"""Settings of the command line: where a label may stand."""

from __future__ import annotations

import pytest

from dextera_build.errors import UsageError
from dextera_build.recipe import settings

CALLS = {("scene",), ("body", "mesh"), ("body", "part", "mesh")}


@pytest.mark.parametrize(
    ("text", "misplaced"),
    [
        ("scene[mug].path=1", "scene[mug]"),
        ("body[mug].mesh[lid].texture_px=1", "mesh[lid]"),
        ("body[mug].mesh.primitives[lid].wall_m=1", "primitives[lid]"),
        ("body.mesh.wall_m[lid]=1", "wall_m[lid]"),
        ("body[mug].part.mesh.wall_m=1", "body[mug]"),
        ("body[mug].part[lid].mesh.primitives.wall_m=1", "body[mug]"),
    ],
)
def test_a_label_that_would_select_nothing_is_refused(text, misplaced):
    with pytest.raises(UsageError, match="selects nothing") as caught:
        settings.parse(text).at(CALLS)
    assert f"`{misplaced}`" in caught.value.message


def test_a_label_selects_a_copy_of_the_innermost_group():
    assert settings.parse("body.part[lid].mesh.primitives.wall_m=1").at(CALLS).labels == (None, "lid")
