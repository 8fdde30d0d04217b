"""Entries as bytes: the short way spells what field by field spells."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.digest import of_bytes
from dextera_build.store.reapi import OutputFile, decode, encode
from dextera_build.store.wire import field, varint

DIGESTS = st.binary(min_size=32, max_size=32).map(bytes.hex)
SIZES = st.one_of(st.integers(0, 300), st.integers(0, 2**62), st.sampled_from([127, 128, 2**14 - 1, 2**14]))
PATHS = st.one_of(st.text(min_size=1, max_size=8), st.sampled_from(["x" * n for n in (126, 127, 128, 129, 20000)]))
BLOBS = st.builds(OutputFile, PATHS, DIGESTS, SIZES, st.just(b""))
HELD = st.builds(lambda path, data: OutputFile(path, of_bytes(data), len(data), data), PATHS, st.binary(max_size=300))
FILES = st.one_of(BLOBS, HELD)


def field_by_field(files: list[OutputFile]) -> bytes:
    message = b""
    for file in files:
        digest = field(1, file.digest.encode()) + b"\x10" + varint(file.size)
        contents = field(5, file.contents) if file.contents else b""
        message += field(2, field(1, file.path.encode()) + field(2, digest) + contents)
    return message


@given(st.lists(FILES, min_size=1, max_size=4))
def test_the_short_way_spells_what_field_by_field_spells(files: list[OutputFile]) -> None:
    assert encode(files) == field_by_field(files)
    assert decode(encode(files)) == files


@given(PATHS, st.binary(min_size=1, max_size=300), DIGESTS, SIZES)
def test_other_bytes_than_the_digest_says_are_refused(path: str, data: bytes, digest: str, size: int) -> None:
    right = OutputFile(path, of_bytes(data), len(data), data)
    for wrong in (right._replace(digest=digest), right._replace(size=size), right._replace(contents=data + b"!")):
        if wrong != right:
            with pytest.raises(ValueError, match="other bytes than the digest says"):
                decode(encode([wrong]))


@given(st.one_of(st.integers(0, 2**64 - 1), st.sampled_from([0, 127, 128, 129, 2**14 - 1, 2**14, 2**14 + 1])))
def test_a_number_has_seven_bits_a_byte(value: int) -> None:
    data = varint(value)
    assert sum((byte & 0x7F) << 7 * place for place, byte in enumerate(data)) == value
    assert [byte >> 7 for byte in data] == [1] * (len(data) - 1) + [0]
    assert len(data) == max(1, -(-value.bit_length() // 7))
