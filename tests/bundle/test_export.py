"""Archives: every blob once, bounded size, deterministic, and small changes change few archives."""

from __future__ import annotations

import hashlib
import io
import tarfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.bundle import export, layout
from dextera_build.bundle.errors import BundleRefused
from dextera_build.bundle.export import archive, packs

SIZES = st.dictionaries(
    st.binary(min_size=1, max_size=8).map(lambda data: hashlib.sha256(data).hexdigest()),
    st.integers(0, 2 * export._PACK),
    max_size=60,
)


def digest(number: int) -> str:
    return hashlib.sha256(str(number).encode()).hexdigest()


def read(data: bytes) -> dict[str, bytes]:
    """The files of an archive, as our reader finds them."""
    with layout.reading("an archive", io.BytesIO(data)) as packed:
        return {info.name: packed.extractfile(info).read() for info in layout.files(packed)}  # type: ignore[union-attr]


@given(SIZES)
def test_every_blob_stands_once_in_an_archive_that_is_bounded_and_in_order(sizes):
    assert sorted(blob for pack in packs(sizes) for blob in pack) == sorted(sizes)
    for pack in packs(sizes):
        octets = sum(sizes[blob] + 2 * tarfile.BLOCKSIZE for blob in pack)
        assert octets <= max(export._PACK, sum(sizes.values()) // export._MANY) or len(pack) == 1
        assert pack == sorted(pack)


@given(SIZES, st.randoms())
def test_the_order_in_which_blobs_are_named_means_nothing(sizes, random):
    shuffled = list(sizes.items())
    random.shuffle(shuffled)
    assert packs(dict(shuffled)) == packs(sizes)


def test_one_more_blob_changes_few_layers():
    sizes = {digest(number): 4 << 20 for number in range(2000)}
    before = [tuple(pack) for pack in packs(sizes)]
    after = [tuple(pack) for pack in packs(sizes | {digest(-1): 4096})]
    assert len(before) > 50
    assert len(set(after) - set(before)) <= 16


def test_there_are_never_too_many_layers():
    """A registry's manifest holds about 4,000 layers; twenty terabytes in files of one size stay below that."""
    for size in (1, 10_000, 1 << 20, 20 << 20, 1 << 30):
        assert len(packs({digest(number): size for number in range(20_000)})) <= 4_000


@given(st.dictionaries(st.from_regex(r"[a-z]{1,90}", fullmatch=True), st.binary(max_size=2000), max_size=8))
def test_an_archive_is_read_by_us_and_by_others(content):
    data = b"".join(archive((name, len(content[name]), [content[name]]) for name in content))
    assert read(data) == content
    with tarfile.open(fileobj=io.BytesIO(data)) as theirs:
        assert {info.name: theirs.extractfile(info).read() for info in theirs} == content  # type: ignore[union-attr]


def test_an_archive_holds_a_bounded_number_of_files(monkeypatch):
    monkeypatch.setattr(layout, "MOST_FILES", 10)
    assert max(map(len, packs({digest(number): 1 for number in range(100)}))) <= 10
    with pytest.raises(BundleRefused) as error:
        read(b"".join(archive((digest(number), 0, []) for number in range(11))))
    assert error.value.code == "DXB-S305"


def test_a_size_beyond_eight_gigabytes_needs_no_second_header():
    assert len(next(archive([("large", 10 << 40, [])]))) == tarfile.BLOCKSIZE


@given(st.binary(min_size=512, max_size=4096))
def test_noise_is_refused_or_empty(data):
    try:
        found = read(data)
    except BundleRefused:
        return
    assert found == {}


def test_a_long_name_is_refused_before_it_is_read():
    info = tarfile.TarInfo("a" * 200)
    info.size = 1 << 60
    with pytest.raises(BundleRefused, match="neither a file nor a folder"):
        read(info.tobuf(tarfile.GNU_FORMAT))
