"""PLY files: every encoding, and what is wrong with the broken ones."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dextera_build.geometry import ply

TABLE = np.array(
    [(1.5, -2, 255, 0.1), (np.pi, 7, 0, -1e-30)], [("x", "f4"), ("count", "i2"), ("red", "u1"), ("time", "f8")]
)


def head(order: str, *lines: str) -> bytes:
    return "\n".join(["ply", f"format {order} 1.0", *lines, "end_header\n"]).encode()


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_what_is_written_is_read(text):
    table, comments = ply.read(ply.written(TABLE, ("frame world", ""), text=text))
    assert table.dtype == TABLE.dtype
    assert np.array_equal(table, TABLE)
    assert comments == ("frame world", "")


def test_big_endian_numbers_are_read():
    lines = ("element vertex 2", *(f"property {kind} {name}" for kind, name in COLUMNS))
    data = head("binary_big_endian", *lines) + TABLE.astype(TABLE.dtype.newbyteorder(">")).tobytes()
    assert np.array_equal(ply.read(data)[0], TABLE)


COLUMNS = (("float", "x"), ("short", "count"), ("uchar", "red"), ("double", "time"))


def test_elements_before_and_after_are_skipped():
    lines = ("element camera 1", "property int a", "element vertex 2", "property float32 x")
    after = ("element face 1", "property list uchar int vertex_indices")
    text = head("ascii", *lines, *after) + b"9\n0.5\n0.25\n3 0 1 2\n"
    assert ply.read(text)[0]["x"].tolist() == [0.5, 0.25]
    binary = head("binary_little_endian", *lines, *after) + np.array([9], "<i4").tobytes()
    assert ply.read(binary + np.array([0.5, 0.25], "<f4").tobytes() + b"\x03...")[0]["x"].tolist() == [0.5, 0.25]


def test_windows_line_ends_of_a_header_are_read():
    data = head("ascii", "element vertex 1", "property float x").replace(b"\n", b"\r\n") + b"2\r\n"
    assert ply.read(data)[0]["x"].tolist() == [2.0]


ONE = ("element vertex 2", "property uchar red")


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "does not begin with a PLY header"),
        (b"solid cube", "does not begin with a PLY header"),
        (b"ply\nformat ascii 1.0\n" + b"comment x\n" * 10_000 + b"end_header\n", "does not begin with a PLY header"),
        (head("morse", *ONE), "names no known encoding"),
        (head("ascii", "element face 0"), "has no element `vertex`"),
        (head("ascii", "element vertex many"), "element `vertex` has no number of rows"),
        (head("ascii", "property float x"), "belongs to no element"),
        (head("ascii", "element vertex 1", "property quad x"), "`x` is of the unknown type `quad`"),
        (head("ascii", "element vertex 1", *2 * ["property int x"]), "two properties of one name"),
        (head("ascii", "element vertex 1", "property list uchar int x"), "a list property stands before or in"),
        (head("binary_little_endian", *ONE) + b"1", "cut short: 1 of 2 rows of `vertex`"),
        (head("ascii", *ONE) + b"1\n", "cut short: 1 of 2 rows of `vertex`"),
        (head("ascii", *ONE) + b"1\nred\n", "holds something that is no number"),
        (head("ascii", *ONE) + b"1\n256\n", "`red` holds numbers that are no uchar"),
        (head("ascii", *ONE) + b"1\n1.5\n", "`red` holds numbers that are no uchar"),
        (head("ascii", *ONE) + b"1\nnan\n", "`red` holds numbers that are no uchar"),
        (head("binary_little_endian", "element vertex 999999999999999999", "property float x"), "cut short: 0 of"),
    ],
)
def test_what_is_broken_is_named(data, why):
    with pytest.raises(ValueError, match=re.escape(why)):
        ply.read(data)
