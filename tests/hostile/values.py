"""What somebody may put where dxb keeps a file of its own."""

from __future__ import annotations

from hypothesis import strategies as st

DEEP = 100_000

BYTES = {
    "nothing": b"",
    "no text": b"\xff\xfe\x00\x01",
    "lists in lists": b"[" * DEEP,
    "closed lists in lists": b"[" * DEEP + b"]" * DEEP,
    "tables in tables": b'{"a":' * DEEP,
    "a number of 5,000 digits": b"9" * 5000,
    "a number": b"1",
    "nothing in JSON": b"null",
    "a list": b"[]",
    "a table": b"{}",
    "half a pair": b'"\\ud800"',
    "no number": b"NaN",
}
"""Bytes that are not the file."""

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(1 << 80), 1 << 80)
    | st.floats()
    | st.sampled_from(["", "..", "../../x", "/etc/passwd", "a\0b", "\x1b[2J", "\ud800", "0" * 64, "f" * 64, "²"])
    | st.text(max_size=6)
)
PLAIN = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=5,
)
"""Plain data as JSON may hold it, and a little more."""


def mutate(here: object, data: st.DataObject) -> None:
    """Replace, remove or double one value somewhere in lists and tables."""
    while True:
        steps = list(here) if isinstance(here, dict) else list(range(len(here))) if isinstance(here, list) else []
        if not steps:
            return
        step = data.draw(st.sampled_from(steps))
        inner = here[step]  # type: ignore[index]
        if isinstance(inner, dict | list) and inner and data.draw(st.integers(0, 3)):
            here = inner
            continue
        match data.draw(st.sampled_from(["replace", "replace", "remove", "double"])):
            case "replace":
                here[step] = data.draw(PLAIN)  # type: ignore[index]
            case "remove":
                del here[step]  # type: ignore[attr-defined]
            case _ if isinstance(here, list):
                here.append(inner)
            case _:
                here[f"{step}x"] = inner  # type: ignore[index]
        return


def torn(good: bytes, data: st.DataObject) -> bytes:
    """The bytes with a piece replaced, cut out or doubled."""
    start = data.draw(st.integers(0, len(good)))
    end = data.draw(st.integers(start, min(len(good), start + 40)))
    piece = data.draw(
        st.binary(max_size=20) | st.just(good[start:end] * 2) | st.sampled_from([b"[" * 2000, b'"', b"\0"])
    )
    return good[:start] + piece + good[end:]
