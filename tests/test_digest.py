"""What is digested has one spelling, whoever writes it."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build import digest

TEXTS = st.text(st.characters(exclude_categories=("Cs",)))
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | TEXTS,
    lambda inner: st.lists(inner) | st.tuples(inner) | st.dictionaries(TEXTS, inner),
    max_leaves=20,
)


@given(PLAIN)
def test_canonical_is_what_the_standard_library_spells(value: Any) -> None:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    assert digest.canonical(value) == text.encode()


def test_what_is_no_plain_data_is_refused_and_leaves_nothing_behind() -> None:
    round_trip: list[Any] = []
    round_trip.append(round_trip)
    good = {"a": [1, 1.0, "1"]}
    for wrong, kind in ((math.nan, ValueError), (math.inf, ValueError), ({1, 2}, TypeError), (round_trip, ValueError)):
        with pytest.raises(kind):
            digest.canonical({"a": {"b": [wrong]}})
        assert digest.canonical(good) == b'{"a":[1,1.0,"1"]}'


def test_what_is_nested_too_deeply_is_refused() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    with pytest.raises(ValueError, match="nested too deeply"):
        digest.canonical(deep)
