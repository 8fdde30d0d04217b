"""Plots of a simulated scene, for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.scenes.scene import Settled, SettleReport

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

WIDTH, CHART, ROW = 640, 200, 26
INK, SOFT, GOOD, BAD = (40, 44, 52), (205, 210, 216), (46, 125, 70), (190, 50, 45)


def settle_picture(report: SettleReport) -> np.ndarray:
    """Plot kinetic energy over time (logarithmic) above one row of numbers per body, (H, 640, 3) uint8."""
    from PIL import Image
    from PIL import ImageDraw as Draw

    picture = Image.new("RGB", (WIDTH, CHART + ROW * (len(report.bodies) + 1) + 10), (255, 255, 255))
    pen = Draw.Draw(picture)
    _energy(pen, report)
    cells = ("body", "drift", "tilt", "penetration", "joints", "")
    _row(pen, CHART, cells, INK)
    for number, body in enumerate(report.bodies):
        _row(pen, CHART + ROW * (number + 1), _cells(body), GOOD if body.resting else BAD)
    return np.array(picture, np.uint8)


def _cells(body: Settled) -> tuple[str, ...]:
    return (
        body.name[:24],
        f"{body.drift_m * 1000:.1f} mm",
        f"{np.degrees(body.tilt_rad):.1f} deg",
        f"{body.penetration_m * 1000:.2f} mm",
        f"{body.joint_drift:.4f}",
        "rests" if body.resting else "does not rest",
    )


def _row(pen: ImageDraw, top: int, cells: tuple[str, ...], colour: tuple[int, int, int]) -> None:
    pen.line([(40, top), (WIDTH - 20, top)], fill=SOFT)
    for left, text in zip((40, 200, 290, 370, 470, 545), cells, strict=True):
        pen.text((left, top + 7), text, fill=colour)


def _energy(pen: ImageDraw, report: SettleReport) -> None:
    left, right, top, bottom = 60, WIDTH - 20, 24, CHART - 30
    low, high = -9.0, max(0.0, float(np.log10(max(report.energy_j.max(), 1e-9))))
    pen.text((left, 6), f"kinetic energy [J] over {report.seconds:g} s", fill=INK)
    for power in range(int(low), int(high) + 1, 3):
        y = bottom - (power - low) / (high - low) * (bottom - top)
        pen.line([(left, y), (right, y)], fill=SOFT)
        pen.text((20, y - 6), f"1e{power}", fill=INK)
    logs = np.log10(np.maximum(report.energy_j, 10.0**low))
    xs = np.linspace(left, right, len(logs))
    ys = bottom - (logs - low) / (high - low) * (bottom - top)
    pen.line([(float(x), float(y)) for x, y in zip(xs, ys, strict=True)], fill=(36, 99, 170), width=2)
