"""The gallery of an asset library: one offline page with a card per asset and a search that runs in the browser."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from dextera_build.report.document import document
from dextera_build.report.html import Html, tag
from dextera_build.report.wording import count


def page(rows: Sequence[Mapping[str, Any]], pictures: Mapping[str, bytes]) -> str:
    """The whole document.

    Args:
        rows: Assets as `index.json` has them.
        pictures: Digest of an asset -> PNG.
    """
    objects = [row for row in rows if row["kind"] == "object"]
    others = len(rows) - len(objects)
    head = tag(
        "header",
        None,
        tag("h1", None, "Asset library"),
        tag("p", {"class": "sub"}, f"{count(len(objects), 'object')}, {count(others, 'background')}"),
        tag(
            "p",
            {"class": "filter"},
            tag("input", {"type": "search", "id": "search", "placeholder": "mug ceramic", "aria-label": "search"}),
            " ",
            tag("span", {"class": "sub", "id": "shown", "aria-live": "polite"}),
        ),
    )
    cards = [_card(row, pictures.get(row["digest"], b"")) for row in rows]
    empty = tag("p", {"class": "quiet", "id": "empty", "hidden": bool(cards)}, "Nothing fits.")
    return document(
        "Asset library",
        tag("main", None, head, tag("div", {"class": "gallery"}, cards), empty),
        styles=("report.css", "gallery.css"),
        script="gallery.js",
    )


def _card(row: Mapping[str, Any], picture: bytes) -> Html:
    source = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
    image = tag("img", {"src": source, "alt": f"{row['kind']} {row['name']}", "loading": "lazy"}) if picture else None
    facts = [tag("div", None, tag("dt", None, name), tag("dd", None, text)) for name, text in _facts(row)]
    return tag(
        "article",
        {"class": f"card asset {row['kind']}", "id": row["digest"][:16], "data-words": row["words"]},
        tag("div", {"class": "shot"}, image),
        tag("h3", None, row["name"], " ", tag("span", {"class": "sub"}, row["category"])),
        tag("dl", {"class": "facts"}, facts),
        tag("p", {"class": "address"}, row["digest"][:16]),
    )


def _facts(row: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if row["size_m"]:
        large = max(row["size_m"]) >= 1.0
        size = " x ".join(f"{edge:.2f}" if large else f"{1000 * edge:.0f}" for edge in row["size_m"])
        yield "size", f"{size} {'m' if large else 'mm'}" + (" (scale unknown)" if row["scale"] == "unknown" else "")
    if row["mass_kg"] is not None:
        yield "mass", f"{_mass(row['mass_kg'])} ({_mass(row['mass_low_kg'])} to {_mass(row['mass_high_kg'])})"
    if row["material"]:
        yield "material", f"{row['material']}, friction {row['friction']:.2f}"
    if row["kind"] == "object":
        yield "joints", "; ".join(_joint(joint) for joint in row["joints"]) or "none"
    yield "made from", {"rgb": "photograph", "rgbd": "photograph and depth"}.get(row["source"], row["source"])
    pieces = count(row["collision_pieces"], "collision piece")
    yield "geometry", f"{row['triangles']:,} triangles, {pieces}"
    yield "node", row["nodes"][0] + (f" and {len(row['nodes']) - 1} more" if len(row["nodes"]) > 1 else "")


def _joint(joint: Mapping[str, Any]) -> str:
    if joint["type"] == "revolute":
        low, high, now = (f"{math.degrees(joint[key]):.0f}" for key in ("lower", "upper", "position"))
        return f"{joint['name']} {low} to {high} deg, seen at {now}"
    low, high, now = (f"{1000 * joint[key]:.0f}" for key in ("lower", "upper", "position"))
    return f"{joint['name']} {low} to {high} mm, seen at {now}"


def _mass(kilograms: float) -> str:
    return f"{kilograms:.2f} kg" if kilograms >= 1.0 else f"{1000 * kilograms:.0f} g"
