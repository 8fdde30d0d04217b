"""The picture of poses that moved: bars to scale, intervals around them, names escaped."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from dextera_build.artifacts.comparison.motion import Motion
from dextera_build.report import moves

SVG = "{http://www.w3.org/2000/svg}"
MOVED = {
    "mount <camera>": Motion("T_camera_base", 0.02, 1.0, (0.018, 0.022), (0.9, 1.1)),
    "scene": Motion("T_world_camera", 0.01, 0.5, None, None),
}


def test_bars_are_to_scale_and_intervals_surround_their_ends() -> None:
    root = ET.fromstring(moves.svg("Moved", MOVED))
    bars = [float(each.get("width", 0)) for each in root.iter(f"{SVG}rect") if each.get("class") == "bar"]
    assert bars[0] == pytest.approx(2 * bars[1], abs=0.2)
    assert bars[2] == pytest.approx(2 * bars[3], abs=0.2)
    lines = [float(each.get(end, 0)) for each in root.iter(f"{SVG}line") for end in ("x1", "x2")]
    first = next(each for each in root.iter(f"{SVG}rect") if each.get("class") == "bar")
    assert min(lines) < float(first.get("x", 0)) + bars[0] < max(lines)
    texts = [each.text for each in root.iter(f"{SVG}text")]
    assert "mount <camera>" in texts
    assert "20 [18, 22]" in texts
    assert "10" in texts


def test_poses_that_turned_only_have_bars_too() -> None:
    root = ET.fromstring(moves.svg("Moved", {"hinge": Motion("T_a_b", 0.0, 2.0, None, None)}))
    bars = [float(each.get("width", 0)) for each in root.iter(f"{SVG}rect") if each.get("class") == "bar"]
    assert bars[0] == 0
    assert bars[1] > 0
