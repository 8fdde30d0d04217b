"""Messages: what is packed comes back, and what is no message is refused."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dextera_build.policy.wire.codec import MessageError, pack, unpack

DTYPES = st.one_of(
    arrays.boolean_dtypes(),
    arrays.integer_dtypes(endianness="?"),
    arrays.unsigned_integer_dtypes(endianness="?"),
    arrays.floating_dtypes(endianness="?"),
    st.sampled_from([np.dtype("<U3"), np.dtype("S2")]),
)
LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(allow_nan=False),
    st.text(),
    st.binary(),
    arrays.arrays(DTYPES, arrays.array_shapes(min_dims=0, min_side=0, max_side=3)),
)
MESSAGES = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3), max_leaves=4
)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        fits = isinstance(other, np.ndarray) and (one.dtype, one.shape) == (other.dtype, other.shape)
        return fits and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and bool(one == other)


@settings(max_examples=30, deadline=None)
@given(MESSAGES)
def test_what_is_packed_comes_back(message: Any) -> None:
    assert same(message, unpack(pack(message)))


@pytest.mark.parametrize("scalar", [np.float32(1.5), np.int8(-3), np.uint64(2**64 - 1), np.bool_(True), np.str_("é")])
def test_scalars_keep_their_type(scalar: np.generic) -> None:
    back = unpack(pack({"scalar": scalar}))["scalar"]
    assert (type(back), back) == (type(scalar), scalar)


def test_an_array_is_the_map_of_openpi() -> None:
    """The bytes that msgpack_numpy of openpi-client 0.1.2 gives for the same message."""
    expected = (
        b"\x81\xa1a\x84\xc4\x0b__ndarray__\xc3\xc4\x04data\xc4\x08\x00\x00\x80?\x00\x00\x00@"
        b"\xc4\x05dtype\xa3<f4\xc4\x05shape\x91\x02"
    )
    assert pack({"a": np.array([1, 2], np.float32)}) == expected
    view = unpack(expected)["a"]
    assert view.tolist() == [1.0, 2.0]
    assert not view.flags.writeable


def test_an_array_that_is_not_contiguous_is_sent_as_it_looks() -> None:
    turned = np.arange(6).reshape(2, 3).T
    np.testing.assert_array_equal(unpack(pack(turned)), turned)


@pytest.mark.parametrize(
    "value",
    [
        np.array([object()]),
        np.array([1j]),
        np.complex64(1),
        np.zeros(2, "V4"),
        np.zeros(1, "i4,f4"),
        object(),
        {1, 2.5j},
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_no_message_holds_is_refused(value: object) -> None:
    with pytest.raises(MessageError):
        pack({"value": value})


def stated(**parts: Any) -> bytes:
    whole = {"__ndarray__": True, "data": b"\0" * 8, "dtype": "<f4", "shape": [2]} | parts
    return pack({name.encode(): part for name, part in whole.items()})


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        pack({"a": 1})[:-1],
        pack(1) + pack(2),
        b"\x91" * 5000 + b"\x01",
        b"\xd4\x01\x01",
        *(stated(dtype=name) for name in ("|O", "<c8", "|V4", "i4,f4", "<U0", "no", 7, "<f4" * 99, "<M8[s]")),
        *(stated(shape=shape) for shape in ([3], [-2], [2**40, 2**40], "2", [1.0, 2.0], [1] * 70 + [2], None)),
        stated(data="text"),
        pack({b"__npgeneric__": True, b"data": "x", b"dtype": "<f4"}),
        pack({b"__npgeneric__": True, b"data": 300, b"dtype": "|i1"}),
        pack({b"__npgeneric__": True, b"data": [1, 2], b"dtype": "<i8"}),
    ],
)
def test_what_is_no_message_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        unpack(data)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=64))
def test_no_bytes_do_more_than_be_refused(data: bytes) -> None:
    with contextlib.suppress(MessageError):
        unpack(data)
