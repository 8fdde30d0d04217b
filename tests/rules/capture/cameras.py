"""The small camera that tests of reference worlds look through."""

from __future__ import annotations

from typing import Any

CAMERA: dict[str, Any] = {
    "width_px": 320,
    "height_px": 180,
    "fx_px": 228.0,
    "fy_px": 226.0,
    "cx_px": 150.0,
    "cy_px": 95.0,
    "eye_m": (0.0, -0.8, 0.7),
    "target_m": (0.0, 0.0, 0.05),
}
