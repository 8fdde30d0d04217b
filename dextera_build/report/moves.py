"""By how much poses moved, as a picture: one bar per pose for the distance and one for the angle, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dextera_build.artifacts.comparison.motion import Motion
from dextera_build.report.html import Html, join, tag

_ROW, _HEAD, _NAME, _BAR, _VALUE = 30, 64, 330, 230, 130
"""Height of a row and of the head, width of the names, of a bar at its longest, and of the number next to it [px]."""
_STYLE = """
svg { font: 12px system-ui, 'DejaVu Sans', sans-serif; background: #fff }
.title { font-size: 15px; font-weight: 600; fill: #1b1e23 } .axis { font-weight: 600; fill: #3d4a5c }
.name { fill: #1b1e23 } .value { fill: #3d4a5c } .row { fill: #f6f7f8 }
.bar { fill: #7fb0d8 } .interval { stroke: #1b1e23; stroke-width: 1.5 }
"""


def svg(title: str, moved: Mapping[str, Motion]) -> str:
    """One SVG document.

    Args:
        title: Its heading.
        moved: Name of a node or field -> its motion, at least one.
    """
    columns = (
        (
            "distance [mm], 95 % interval",
            [_scaled(each.distance_m, each.distance_interval_m) for each in moved.values()],
        ),
        ("angle [deg], 95 % interval", [(each.angle_deg, each.angle_interval_deg) for each in moved.values()]),
    )
    width, height = _NAME + len(columns) * (_BAR + _VALUE), _HEAD + _ROW * len(moved) + 10
    rows = [
        join([_band(row, width), tag("text", {"x": 10, "y": _middle(row) + 4, "class": "name"}, name)])
        for row, name in enumerate(moved)
    ]
    bars = [_column(_NAME + place * (_BAR + _VALUE), *column) for place, column in enumerate(columns)]
    return tag(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": f"0 0 {width} {height}",
            "width": width,
            "height": height,
            "role": "img",
            "aria-label": title,
        },
        tag("style", None, Html(_STYLE)),
        tag("text", {"x": 10, "y": 26, "class": "title"}, title),
        rows,
        bars,
    )


_Length = tuple[float, tuple[float, float] | None]


def _scaled(metres: float, interval: tuple[float, float] | None) -> _Length:
    """In millimetres."""
    return 1000 * metres, None if interval is None else (1000 * interval[0], 1000 * interval[1])


def _column(left: int, heading: str, values: Sequence[_Length]) -> Html:
    """All bars of one quantity on one scale, from 0."""
    longest = max(max(value, interval[1] if interval else 0.0) for value, interval in values) or 1.0
    parts = [tag("text", {"x": left, "y": _HEAD - 12, "class": "axis"}, heading)]
    for row, (value, interval) in enumerate(values):
        y, scale = _middle(row), _BAR / longest
        parts.append(tag("rect", {"x": left, "y": y - 7, "width": value * scale, "height": 14, "class": "bar"}))
        told = f"{value:.3g}"
        if interval is not None:
            parts.append(_line(left + interval[0] * scale, y, left + interval[1] * scale, y))
            parts += [_line(left + edge * scale, y - 5, left + edge * scale, y + 5) for edge in interval]
            told += f" [{interval[0]:.3g}, {interval[1]:.3g}]"
        parts.append(tag("text", {"x": left + _BAR + 8, "y": y + 4, "class": "value"}, told))
    return join(parts)


def _line(x: float, y: float, to_x: float, to_y: float) -> Html:
    return tag("line", {"x1": x, "y1": y, "x2": to_x, "y2": to_y, "class": "interval"})


def _middle(row: int) -> int:
    return _HEAD + _ROW * row + _ROW // 2


def _band(row: int, width: int) -> Html | None:
    """Every other row is shaded."""
    if row % 2:
        return None
    return tag("rect", {"x": 0, "y": _HEAD + _ROW * row, "width": width, "height": _ROW, "class": "row"})
