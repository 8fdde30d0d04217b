"""Former addresses of rules."""

from __future__ import annotations

import pytest

from dextera_build.code.loader import Library
from dextera_build.code.renamed import RENAMED
from dextera_build.errors import RecipeError


@pytest.mark.parametrize("former", ["capture.mesh", "capture.labels"])
def test_a_former_address_is_answered_with_the_current_one(former):
    with pytest.raises(RecipeError) as caught:
        Library().find(former)
    assert (caught.value.code, caught.value.message) == ("DXB-R201", f"the rule `{former}` is now `capture.file`")
    assert caught.value.hint == f"write `rule: {RENAMED[former]}`"


def test_every_current_address_is_a_rule_and_no_former_one_is():
    library = Library()
    known = {found.path for found in library.rules()}
    assert {now.partition(",")[0] for now in RENAMED.values()} <= known
    assert not known & RENAMED.keys()
