"""One page of black rectangles and text as PDF 1.7 (ISO 32000-1), at true size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

POINT_MM = 25.4 / 72.0
"""A point, the unit of PDF [mm]."""
PAPERS_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Name of a paper -> width and height of the upright sheet [mm]."""


class Rectangle(NamedTuple):
    """A rectangle on a page; y goes down from the upper edge."""

    x_mm: float
    """Left edge."""
    y_mm: float
    """Upper edge."""
    width_mm: float
    """Width."""
    height_mm: float
    """Height."""


class Text(NamedTuple):
    """A line of text in Helvetica, ASCII."""

    x_mm: float
    """Left end of its base line."""
    y_mm: float
    """Base line, from the upper edge."""
    size_mm: float
    """Height of the font."""
    text: str
    """The line."""


def page(
    size_mm: tuple[float, float], shapes: Iterable[Sequence[Rectangle]], texts: Iterable[Text], title: str
) -> bytes:
    """The bytes of a document with one page, which viewers print without scaling.

    Args:
        size_mm: Width and height of the page.
        shapes: Groups of rectangles; each is one path, so that no seams show between neighbours.
        texts: Lines of text.
        title: Title of the document.
    """
    drawn = [_path(group, size_mm[1]) for group in shapes]
    drawn += [_line(text, size_mm[1]) for text in texts]
    stream = "\n".join(["0 g", *drawn]).encode("ascii")
    box = " ".join(_points(side) for side in (0.0, 0.0, *size_mm)).encode("ascii")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [%s] /Contents 4 0 R\n/Resources << /Font << /F 5 0 R >> >> >>" % box,
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(stream), stream),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        f"<< /Title ({_escaped(title)}) /Producer (dextera-build) >>".encode("ascii"),
    ]
    return _document(objects)


def _document(objects: list[bytes]) -> bytes:
    """Objects with their cross-reference table; the first is the catalogue, the last the document information."""
    found, places = b"%PDF-1.7\n", []
    for number, each in enumerate(objects, 1):
        places.append(len(found))
        found += b"%d 0 obj\n%s\nendobj\n" % (number, each)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    count = len(objects) + 1
    trailer = b"trailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        count,
        len(objects),
        len(found),
    )
    return found + b"xref\n0 %d\n0000000000 65535 f \n" % count + table + trailer


def _path(group: Sequence[Rectangle], height: float) -> str:
    rows = []
    for each in group:
        corner = (each.x_mm, height - each.y_mm - each.height_mm)
        rows.append(" ".join(map(_points, (*corner, each.width_mm, each.height_mm))) + " re")
    return "\n".join([*rows, "f"])


def _line(text: Text, height: float) -> str:
    where = f"{_points(text.x_mm)} {_points(height - text.y_mm)} Td"
    return f"BT /F {_points(text.size_mm)} Tf {where} ({_escaped(text.text)}) Tj ET"


def _points(length_mm: float) -> str:
    return f"{length_mm / POINT_MM:.6f}".rstrip("0").rstrip(".")


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
