"""TFRecords: their bytes are those of TensorFlow's format."""

from __future__ import annotations

import io
import struct

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.formats import tfrecord

POLYNOMIAL = 0x82F63B78
"""Castagnoli's, with its bits reversed."""


def crc32c(data: bytes) -> int:
    """The checksum, bit by bit."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (POLYNOMIAL if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def records(data: bytes) -> list[bytes]:
    """The messages of a file, by the format's description; both checksums are compared."""
    found = []
    while data:
        length, told = struct.unpack_from("<QI", data)
        message, (own,) = data[12 : 12 + length], struct.unpack_from("<I", data, 12 + length)
        for part, masked in ((data[:8], told), (message, own)):
            rotated = (masked - 0xA282EAD8) % 2**32
            assert ((rotated >> 17) | (rotated << 15)) % 2**32 == crc32c(part)
        found.append(message)
        data = data[16 + length :]
    return found


def test_the_checksum_of_this_test_is_that_of_the_standard() -> None:
    assert crc32c(b"123456789") == 0xE3069283


@given(st.lists(st.binary(max_size=300), max_size=4))
def test_records_come_back(messages: list[bytes]) -> None:
    file = io.BytesIO()
    for message in messages:
        tfrecord.append(file, message)
    assert records(file.getvalue()) == messages


def test_an_example_has_the_bytes_of_its_protocol() -> None:
    made = tfrecord.example({"b": np.array([True, False]), "a": np.array([[1.5, 2.0]], np.float32), "c": [b"x", b""]})
    # Field 1 of Example is Features, whose field 1 is a map entry: key (field 1), Feature (field 2). Feature has
    # bytes_list (1), float_list (2) or int64_list (3), each with `value` (1); numbers are packed.
    floats = b"\x0a\x01a\x12\x0c\x12\x0a\x0a\x08" + struct.pack("<2f", 1.5, 2.0)
    truths = b"\x0a\x01b\x12\x06\x1a\x04\x0a\x02\x01\x00"
    texts = b"\x0a\x01c\x12\x07\x0a\x05\x0a\x01x\x0a\x00"
    entries = b"".join(b"\x0a" + bytes([len(entry)]) + entry for entry in (floats, truths, texts))
    assert made == b"\x0a" + bytes([len(entries)]) + entries
