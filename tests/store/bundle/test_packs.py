"""Layers: every blob once, bounded, the same for the same blobs, and little changes where little changed."""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.store.bundle import packs, tar
from dextera_build.store.bundle.refusal import BundleRefused

LARGE = 10_000
SIZES = st.dictionaries(
    st.binary(min_size=1, max_size=8).map(lambda data: hashlib.sha256(data).hexdigest()),
    st.integers(0, 3 * LARGE),
    max_size=60,
)


def digest(number: int) -> str:
    return hashlib.sha256(str(number).encode()).hexdigest()


@given(SIZES)
def test_every_blob_stands_once(sizes):
    layers = packs.layers(sizes, LARGE)
    held = [blob for layer in layers for blob in layer.blobs]
    assert sorted(held) == sorted(sizes.items())
    assert all(len(layer.blobs) == 1 for layer in layers if layer.alone)
    assert {layer.alone for layer in layers for _, size in layer.blobs if size >= LARGE} <= {True}


@given(SIZES)
def test_an_archive_is_bounded_and_in_order(sizes):
    for layer in packs.layers(sizes, LARGE):
        if not layer.alone:
            assert tar.length(size for _, size in layer.blobs) <= 4 * LARGE + 2 * tar.BLOCK or len(layer.blobs) == 1
            assert list(layer.blobs) == sorted(layer.blobs)


@given(SIZES, st.randoms())
def test_the_order_in_which_blobs_are_named_means_nothing(sizes, random):
    shuffled = list(sizes.items())
    random.shuffle(shuffled)
    assert packs.layers(dict(shuffled), LARGE) == packs.layers(sizes, LARGE)


def test_one_more_blob_changes_few_layers():
    sizes = {digest(number): 1000 for number in range(2000)}
    before = packs.layers(sizes, LARGE)
    after = packs.layers(sizes | {digest(-1): 1000}, LARGE)
    assert len(before) > 50
    assert len(set(after) - set(before)) <= 2


def test_there_are_never_too_many_layers():
    """A registry's manifest holds some 20,000; ten terabytes in files of all sizes stay far below."""
    for size in (1, 10_000, 1 << 20, 20 << 20, 1 << 30):
        sizes = {digest(number): size for number in range(20_000)}
        assert len(packs.layers(sizes)) <= 3_000


@given(
    st.dictionaries(st.from_regex(r"[a-z]{1,90}", fullmatch=True), st.binary(max_size=2000), max_size=8),
    st.integers(1, 700),
)
def test_an_archive_is_read_by_us_and_by_others(content, step):
    data = b"".join(tar.header(n, len(d)) + d + tar.padding(len(d)) for n, d in content.items()) + tar.end()
    assert len(data) == tar.length(len(d) for d in content.values())
    pieces = (data[start : start + step] for start in range(0, len(data), step))
    assert {file.name: b"".join(parts) for file, parts in tar.Reader(pieces).files()} == content
    with tarfile.open(fileobj=io.BytesIO(data)) as theirs:
        assert {info.name: theirs.extractfile(info).read() for info in theirs} == content  # type: ignore[union-attr]


def test_sizes_beyond_eight_gigabytes_need_no_second_header():
    block = tar.header("large", 10 << 40)
    assert len(block) == tar.BLOCK
    assert tar.read_header(block) == tar.File("large", 10 << 40)


@given(st.binary(min_size=512, max_size=4096))
def test_noise_is_refused_or_empty(data):
    def pieces() -> Iterator[bytes]:
        yield data

    try:
        found = [(file, b"".join(parts)) for file, parts in tar.Reader(pieces()).files()]
    except BundleRefused:
        return
    assert found == []


def test_a_header_of_another_program_is_read_as_it_is_meant():
    files = tar.Reader(iter([tarfile.TarInfo("a" * 200).tobuf(tarfile.GNU_FORMAT)])).files()
    with pytest.raises(BundleRefused, match="long name"):
        next(files)
