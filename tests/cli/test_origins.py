"""How trees of causes and origins are printed."""

from __future__ import annotations

from dextera_build.explain.origins import margin


def test_a_tree_stands_in_by_two_spaces_a_level() -> None:
    assert [margin(depth) for depth in (0, 1, 40)] == ["", "  ", " " * 80]


def test_a_chain_of_a_hundred_thousand_is_not_printed_as_spaces() -> None:
    margins = [margin(depth) for depth in range(100_000)]
    assert max(map(len, margins)) < 100
    assert len(set(margins)) == 100_000
