"""Films of episodes: packed and unpacked."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.tasks import episode
from dextera_build.artifacts.tasks.episode import Film
from dextera_build.errors import ArtifactError
from dextera_build.store.store import Reader, Store


def film(data: bytes, width: int = 4, height: int = 3) -> Film:
    return Film(frames={"0": data}, width=width, height=height)


@given(st.integers(1, 5), st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=40)
def test_what_is_packed_comes_back(steps, height, width, seed):
    pixels = np.random.default_rng(seed).integers(0, 256, (steps, height, width, 3), np.uint8)
    assert np.array_equal(film(Film.packed(pixels), width, height).pixels("0"), pixels)


GOOD = Film.packed(np.full((5, 3, 4, 3), 90, np.uint8))


@pytest.mark.parametrize(
    ("damaged", "why"),
    [
        (b"no stream", "incorrect header check"),
        (GOOD[:-3], "its end is missing"),
        (b"", "its end is missing"),
        (zlib.compress(bytes(37)), "its last frame is not whole"),
    ],
)
def test_a_damaged_film_is_refused(damaged, why):
    with pytest.raises(ArtifactError, match="the film of episode 0 cannot be read") as caught:
        film(damaged).pixels("0")
    assert caught.value.code == "DXB-A113"
    assert why in str(caught.value.facts["why"])


def test_a_film_without_an_area_is_refused():
    with pytest.raises(ArtifactError, match="cannot be read"):
        film(GOOD, width=0).pixels("0")


def test_a_small_stream_that_would_fill_the_memory_is_refused(monkeypatch):
    monkeypatch.setattr(episode, "_MOST", 1 << 16)
    with pytest.raises(ArtifactError, match="cannot be read") as caught:
        film(zlib.compress(bytes(36 << 20))).pixels("0")
    assert caught.value.facts["why"] == "more than 1 GiB"


def test_the_frames_of_a_stored_film_are_read_when_they_are_used(tmp_path, monkeypatch):
    shown = {index: np.full((2, 3, 4, 3), 40 + int(index), np.uint8) for index in ("1", "2")}
    for index, pixels in shown.items():
        (tmp_path / index).write_bytes(Film.packed(pixels))
    store = Store(tmp_path / "store")
    key = Film.of({index: tmp_path / index for index in shown}, 4, 3).encode(store.writer)
    assert key == Film(frames={i: Film.packed(p) for i, p in shown.items()}, width=4, height=3).encode(store.writer)
    read = []
    get = Reader.__call__
    monkeypatch.setattr(Reader, "__call__", lambda self, digest: read.append(digest) or get(self, digest))
    stored = Film.decode(key, store.reader)
    assert list(stored.frames) == ["1", "2"]
    assert read == [key]
    assert np.array_equal(stored.pixels("2"), shown["2"])
    assert len(read) == 2
