"""Files of installed distributions: found, chosen by patterns, with their licence, or refused by name."""

from __future__ import annotations

import pytest

from dextera_build.errors import RuleError
from dextera_build.sim.model import published

HERE = "mujoco/include/mujoco"


def test_files_come_with_the_licence_of_their_distribution():
    found = published.files("mujoco", HERE, ["mj*.h"])
    assert b"mjModel" in found["mjmodel.h"]
    stated = published.stated(found)
    assert any(b"Apache License" in text for text in stated.values())
    assert set(found) - set(stated) == {name for name in published.files("mujoco", HERE) if name.startswith("mj")}


@pytest.mark.parametrize(
    ("name", "folder", "only", "message"),
    [
        ("no_such_thing", HERE, [], "`no_such_thing` is not installed"),
        ("mujoco", "mujoco/includes", [], r"has no `mujoco/includes`"),
        ("mujoco", HERE, ["mjmodle.h"], "has nothing like `mjmodle.h`"),
    ],
)
def test_what_is_not_there_is_one_error(name, folder, only, message):
    with pytest.raises(RuleError, match=message) as caught:
        published.files(name, folder, only)
    assert caught.value.code == "DXB-B213"
    assert caught.value.hint
