"""Protocol buffers as bytes: whatever is written is read, and whatever else is read ends in a `ValueError`."""

from __future__ import annotations

import contextlib
import tracemalloc
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.store import reapi, wire
from tests.store.remotes.messages import CLASSES, messages

ANY = st.sampled_from(CLASSES).flatmap(messages)
OUTPUTS = st.builds(
    reapi.OutputFile, st.text(max_size=9), st.just("a" * 64), st.integers(0, 1 << 50), st.binary(max_size=200)
)
PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])


@dataclass(frozen=True)
class Inner:
    """A text and a number."""

    name: Annotated[str, 1] = ""
    count: Annotated[int, 2] = 0


@dataclass(frozen=True)
class Outer:
    """Each kind of field."""

    inner: Annotated[Inner, 1] = Inner()
    numbers: Annotated[tuple[int, ...], 2] = ()
    flag: Annotated[bool, 3] = False
    names: Annotated[tuple[str, ...], 16] = ()


@PATIENT
@given(ANY)
def test_what_is_written_is_read(message: Any) -> None:
    assert wire.decode(type(message), wire.encode(message)) == message


@PATIENT
@given(st.integers(-(1 << 63), (1 << 63) - 1))
def test_numbers_are_64_bits_with_a_sign(number: int) -> None:
    assert wire.decode(Inner, wire.encode(Inner("", number))).count == number
    assert wire.decode(Outer, wire.encode(Outer(numbers=(number, 0, number)))).numbers == (number, 0, number)
    assert len(wire.varint(number)) == (10 if number < 0 else max(1, -(-number.bit_length() // 7)))


@pytest.mark.parametrize(
    ("message", "data"),
    [
        (Inner("testing", 150), "0a0774657374696e67" + "109601"),
        (Inner("", -1), "10ffffffffffffffffff01"),
        (Outer(Inner("a", 1), (3, 270, 86942)), "0a050a01611001" + "1206038e029ea705"),
        (Outer(flag=True, names=("b", "")), "1801" + "82010162" + "820100"),
        (Outer(), ""),
    ],
)  # fmt: skip
def test_the_bytes_are_those_of_the_protocol(message: Any, data: str) -> None:
    """150, "testing" and 3, 270, 86942 are the examples of the protocol's own page on its encoding."""
    assert wire.encode(message).hex() == data
    assert wire.decode(type(message), bytes.fromhex(data)) == message


def test_what_others_may_write_is_read_too() -> None:
    unpacked, packed = bytes.fromhex("1003108e02"), bytes.fromhex("1203038e02")
    assert wire.decode(Outer, unpacked).numbers == (3, 270)
    assert wire.decode(Outer, packed + unpacked).numbers == (3, 270, 3, 270)
    assert wire.decode(Outer, wire.encode(Outer(Inner("a", 1))) + wire.encode(Outer(Inner("b")))).inner == Inner("b", 1)
    unknown = bytes.fromhex("2001" + "2900000000000000ff" + "3201aa" + "3d00000000")
    fixed = bytes.fromhex("09") + b"8 bytes." + bytes.fromhex("15") + b"four"
    assert wire.decode(Outer, unknown + fixed + wire.encode(Outer(flag=True)) + unknown) == Outer(flag=True)


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (Inner, wire.field(1, b"\x80") + wire.field(1, b"good")),
        (Outer, wire.field(1, wire.field(1, b"\x80")) + wire.field(1, wire.field(1, b"good"))),
        (Outer, wire.field(1, wire.field(1, b"good")[:3]) + wire.field(1, wire.field(1, b"good")[3:])),
    ],
)
def test_what_a_later_part_overrides_is_read_with_the_rest(kind: type, data: bytes) -> None:
    with pytest.raises(ValueError, match=r"decode|too early"):
        wire.decode(kind, data)


@PATIENT
@given(st.sampled_from(CLASSES), st.binary(max_size=200))
def test_arbitrary_bytes_are_a_message_or_a_value_error(kind: type, data: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert isinstance(wire.decode(kind, data), kind)


@PATIENT
@given(ANY, st.data())
def test_changed_and_cut_messages_are_a_message_or_a_value_error(message: Any, data: st.DataObject) -> None:
    whole = wire.encode(message)
    place = data.draw(st.integers(0, len(whole)))
    cut, changed = whole[:place], bytearray(whole)
    if place < len(whole):
        changed[place] ^= 1 << data.draw(st.integers(0, 7))
    for one in (cut, bytes(changed)):
        for read in (lambda: wire.decode(type(message), one), lambda: reapi.decode(one)):  # noqa: B023 - called at once
            with contextlib.suppress(ValueError):
                read()


@PATIENT
@given(st.lists(OUTPUTS, max_size=4), st.data())
def test_a_result_that_was_cut_says_nothing_wrong(outputs: list[reapi.OutputFile], data: st.DataObject) -> None:
    whole = reapi.encode(outputs)
    with contextlib.suppress(ValueError):
        left = reapi.decode(whole[: data.draw(st.integers(0, len(whole)))])
        assert left == outputs[: len(left)]


@pytest.mark.parametrize(
    "data",
    [
        "00",  # field 0
        "0a",  # no length
        "0a05",  # too short
        "0affffffff0f",  # four gigabytes
        "0affffffffffffffffff01",  # more than there can be
        "10" + "ff" * 10 + "01",  # eleven bytes
        "10" + "ff" * 9 + "02",  # 65 bits
        "80" * 9 + "01",  # a field number of 60 bits
        "0b0c",  # a group
        "0e",  # a wire type that there is not
        "0a0180",  # not UTF-8
        "0801",  # a number where a text is needed
        "12021001",  # bytes where a number is needed
        "0d000000",
    ],
)
def test_what_is_no_message_is_refused(data: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        wire.decode(Inner, bytes.fromhex(data))


def test_memory_is_in_proportion_to_the_bytes() -> None:
    many = wire.field(2, b"\x01" * 100_000)
    bomb = b"".join(wire.field(1, wire.field(1, b"")) for _ in range(10_000)) + b"\x0a\xff\xff\xff\xff\x07"
    tracemalloc.start()
    try:
        assert len(wire.decode(Outer, many).numbers) == 100_000
        with pytest.raises(ValueError, match="too early"):
            wire.decode(Outer, bomb)
        assert tracemalloc.get_traced_memory()[1] < 8_000_000
    finally:
        tracemalloc.stop()
