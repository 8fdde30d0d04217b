"""A twin in canonical frames, as a user types it: other object frames, and the same scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build import Project
from dextera_build.geometry import kinematics, transforms
from tests import factories, tabletops


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_assets_in_canonical_frames_make_the_same_scene(tmp_path: Path) -> None:
    (tmp_path / "dxb.toml").write_text("")
    thing = tabletops.box(0.12, 0.05, 0.16, (0.75, 0.15, 0.1)), factories.pose(0.02, -0.03, yaw=0.4)
    tabletops.write(tabletops.tabletop(thing).capture, tmp_path / "shot")
    project = Project.find(tmp_path)
    built = project.build("twin/tabletop:canonical", inputs={"capture": str(tmp_path / "shot")}, profile="cpu")
    assert built.ok, built.errors
    names = built.artifact("canonical_scene").bodies
    assert names
    for name in names:
        own, canonical = (built.artifact(f"body[{name}].{node}") for node in ("asset", "canonical_asset"))
        upright = kinematics.posed_surface(canonical.body)[0]
        assert abs(upright[:, 2].min()) < 1e-6
        np.testing.assert_allclose(
            transforms.apply(canonical.pose.matrix, upright),
            transforms.apply(own.pose.matrix, kinematics.posed_surface(own.body)[0]),
            atol=1e-6,
        )
