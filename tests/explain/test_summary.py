"""The differences of two runs in one sentence."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.comparison import motion
from dextera_build.artifacts.comparison.difference import Difference
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.explain.compare import Row
from dextera_build.explain.summary import first_moved, sentence
from dextera_build.geometry import lie, transforms


def moved(child: str, shift_m: float, turn_deg: float, sigma: float, name: str = "type", parent: str = "world") -> Row:
    """A row for a pose that moved along x and turned about z."""
    old = Pose(parent=parent, child=child, matrix=np.eye(4), covariance=sigma**2 * np.eye(6))
    matrix = transforms.rigid(lie.about_z(np.radians(turn_deg)), np.array([shift_m, 0, 0]))
    found = motion.between(old, old.model_copy(update={"matrix": matrix}))
    assert found is not None
    return Row("output", name, str(found), Difference("", "pose", "", "", found.distance_m, 1, 1, found))


def test_it_names_what_moved_what_stayed_and_how_many_nodes_differ():
    other = Row("output", "pixels", "uint8 (9, 8, 3): 1 of 216 differ", Difference("pixels", "array", "", "", 1.0, 1))
    found = {
        "photo": [other],
        "world": [moved("camera", 0.5, 9.0, 1e-4, "camera_pose")],
        "mount": [moved("base", 0.0189, 1.0, 1e-4, parent="camera")],
        "camera": [other, moved("camera", 0.01891, 1.0, 1e-4)],
        "base": [moved("base", 0.0003, 0.01, 1e-3)],
    }
    assert sentence(found, 56) == "camera moved 18.9 mm, 1.0 deg; base stayed; 5 of 56 nodes differ"
    assert list(first_moved(found)) == ["world", "mount", "camera", "base", "photo"]
    assert sentence({"": [other, other]}) == "2 differences"
    assert sentence({}, 56) == ""
