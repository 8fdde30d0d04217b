"""align.photographs on real photographs, with the stated motion of the camera as truth."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from tests.benchmarks import several_real
from tests.installed import needs

needs("open3d", "pycolmap", "cv2")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not several_real.CAPTURE.exists(), reason="needs shared/captures/kitchen_table"),
]


def test_a_view_is_placed_beside_another_one(tmp_path):
    off = several_real.placed(tmp_path, 390, 420)
    assert 1000 * np.linalg.norm(off[:3, 3]) < 25.0
    assert np.degrees(transforms.angle(off[:3, :3])) < 1.5


@pytest.mark.parametrize("frame", [340, 420])
def test_a_stated_pose_that_slid_along_the_table_is_refused(tmp_path, frame):
    # Views of this recording look along the table's edge, so that sideways is along the table.
    slid = transforms.rigid(np.eye(3), np.array([0.2, 0.0, 0.0]))
    with pytest.raises(RuleError, match=rf"`{frame}\.png` contradicts the other photographs"):
        several_real.placed(tmp_path, 390, frame, off=slid)
