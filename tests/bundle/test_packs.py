"""Layers: every blob once, bounded, the same for the same blobs, and little changes where little changed."""

from __future__ import annotations

import hashlib
import io
import tarfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.bundle import packs, tar
from dextera_build.bundle.errors import BundleRefused

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
            octets = sum(size + 2 * tar.BLOCK for _, size in layer.blobs)
            assert octets <= 4 * LARGE or len(layer.blobs) == 1
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
    data = b"".join(tar.header(n, len(d)) + d + tar.padding(len(d)) for n, d in content.items()) + tar.END
    pieces = (data[start : start + step] for start in range(0, len(data), step))
    assert {name: b"".join(parts) for name, _, parts in tar.files(pieces)} == content
    with tarfile.open(fileobj=io.BytesIO(data)) as theirs:
        assert {info.name: theirs.extractfile(info).read() for info in theirs} == content  # type: ignore[union-attr]


def test_the_size_of_a_layer_is_that_of_its_bytes():
    blobs = {hashlib.sha256(data).hexdigest(): data for data in (b"", b"x" * 511, b"y" * 512, b"z" * 513)}
    (layer,) = packs.layers({name: len(data) for name, data in blobs.items()})
    whole = b"".join(layer.chunks(lambda name: iter([blobs[name]])))
    found = layer.describe(lambda name: iter([blobs[name]]), 0)
    assert (found.size, found.digest) == (len(whole), hashlib.sha256(whole).hexdigest())


def test_an_archive_holds_a_bounded_number_of_files(monkeypatch):
    monkeypatch.setattr(tar, "MOST_FILES", 10)
    layers = packs.layers({digest(number): 1 for number in range(100)}, LARGE)
    assert max(len(layer.blobs) for layer in layers) <= 10
    too_many = b"".join(tar.header(digest(number), 0) for number in range(11)) + tar.END
    with pytest.raises(BundleRefused) as error:
        list(tar.files(iter([too_many])))
    assert error.value.code == "DXB-S305"


def test_a_size_beyond_eight_gigabytes_needs_no_second_header():
    assert len(tar.header("large", 10 << 40)) == tar.BLOCK


@given(st.binary(min_size=512, max_size=4096))
def test_noise_is_refused_or_empty(data):
    try:
        found = [(name, b"".join(parts)) for name, _, parts in tar.files(iter([data]))]
    except BundleRefused:
        return
    assert found == []


def test_a_long_name_is_refused_before_it_is_read():
    info = tarfile.TarInfo("a" * 200)
    info.size = 1 << 60
    with pytest.raises(BundleRefused, match="neither a file nor a folder"):
        next(tar.files(iter([info.tobuf(tarfile.GNU_FORMAT)])))
