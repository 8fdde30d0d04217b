"""The quality of a report's pictures: the finest that fits, and how often pictures are compressed for it."""

from __future__ import annotations

import io
from collections import Counter
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image

from dextera_build.report import fitting, pictures
from dextera_build.report.films import Films
from dextera_build.report.fitting import fitted
from dextera_build.report.pictures import LADDER, Pictures, Quality
from tests.report.fabricate import FakeStore

COUNT = 200
BARE = 1000
"""Bytes of a page without pictures."""


class Counting(Pictures):
    """Makes addresses as long as their pictures' quality says, and counts them."""

    made: ClassVar[Counter[Quality]] = Counter()

    def _make(self, digest: str, side: int) -> tuple[str, int, int] | None:
        Counting.made[self._quality] += 1
        length = self._quality.webp * (2 if int(digest, 16) % 2 else 1)
        return "x" * length, side, side


@pytest.fixture(autouse=True)
def counting(monkeypatch: pytest.MonkeyPatch) -> None:
    Counting.made.clear()
    monkeypatch.setattr(fitting, "Pictures", Counting)


def stored(count: int) -> tuple[FakeStore, list[str]]:
    store = FakeStore()
    buffer = io.BytesIO()
    Image.fromarray(np.zeros((4, 6, 3), np.uint8)).save(buffer, "PNG")
    names = [f"{number:064x}" for number in range(count)]
    for name in names:
        store.blobs.data[name] = buffer.getvalue()
    return store, names


def drawn(store: Any, names: list[str], limit: int, filmed: int = 0, **more: Any) -> str:
    """The page of all pictures as thumbnails, and of a film of so many bytes."""

    def draw(shown: Pictures, films: Films | None) -> str:
        addresses = "".join((shown.uri(name, "small") or ("",))[0] for name in names)
        return "-" * BARE + addresses + ("f" * filmed if films else "")

    return fitted(draw, store, Films(store), limit, **more)


def bytes_at(level: int, count: int = COUNT) -> int:
    return BARE + LADDER[level].webp * count * 3 // 2


@pytest.mark.parametrize("level", range(len(LADDER)))
def test_the_finest_quality_that_fits_is_taken_and_others_see_a_sample(level: int) -> None:
    store, names = stored(COUNT)
    text = drawn(store, names, bytes_at(level) + 100)
    assert len(text) == bytes_at(level)
    for number, quality in enumerate(LADDER):
        tried = number < level and number < len(LADDER) - 1
        assert Counting.made[quality] == (COUNT if number == level else 23 if tried else 0)


def test_without_room_the_coarsest_is_taken_all_the_same() -> None:
    store, names = stored(COUNT)
    assert len(drawn(store, names, 10)) == bytes_at(len(LADDER) - 1)


def test_films_go_first_and_pictures_are_not_compressed_again() -> None:
    store, names = stored(COUNT)
    assert drawn(store, names, bytes_at(0) + 500, filmed=400).endswith("f" * 400)
    Counting.made.clear()
    assert drawn(store, names, bytes_at(0) + 100, filmed=400).endswith("x")
    assert Counting.made == {LADDER[0]: COUNT}


def test_a_wrong_estimate_leads_to_the_next_quality(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fitting, "_first", lambda *_: 0)
    store, names = stored(COUNT)
    assert len(drawn(store, names, bytes_at(2))) == bytes_at(2)


def test_progress_counts_each_picture_once(capsys: pytest.CaptureFixture[str]) -> None:
    store, names = stored(COUNT)
    heard: list[tuple[int, int]] = []
    drawn(store, [*names, names[0]], bytes_at(0) + 100, told=lambda done, count: heard.append((done, count)))
    assert heard == [(number, COUNT) for number in range(1, COUNT + 1)]


def test_a_sketch_knows_sizes_without_compressing_and_leaves_out_what_is_no_picture() -> None:
    store, (good, bad) = stored(2)
    store.blobs.data[bad] = b"no picture"
    sketch = pictures.Sketch(store)
    assert sketch.uri(good, "large") == ("", 6, 4)
    assert sketch.uri(bad, "large") is None
    assert sketch.uri(good, "large") is not None
    assert sketch.wanted == {(good, "large"): 2}
