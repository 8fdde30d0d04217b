"""twin/generated_room as a user types it: Gaussians of unknown scale, of an image from elsewhere, around a twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build import Project
from dextera_build.artifacts.scenes.scene_fit import AlignedScene, SceneFit
from dextera_build.geometry import transforms
from tests import tabletops

FACTOR = 0.4
"""Units of the generated room per metre, which the recipe is not told."""
GENERATOR = f"""
summary: In place of a generator, the pixels of a picture from 10 cm beside the capture, in an unknown unit.
nodes:
  world:
    rule: reference.world
    camera: {{width_px: 960, height_px: 540, fx_px: 684, fy_px: 684, cx_px: 481, cy_px: 270,
              eye_m: [0.0, -0.78, 0.66], target_m: [0.0, 0.0, 0.05]}}
    table: {{centre_m: [0.0, -0.13], size_m: [1.48, 0.74, 0.035]}}
    objects:
      carton_0: {{kind: carton, size_m: [0.16, 0.07, 0.2], seed: 5, at_m: [-0.45, 0.0], yaw_deg: -40}}
      carton_1: {{kind: carton, size_m: [0.16, 0.07, 0.2], seed: 6, at_m: [-0.23, 0.05], yaw_deg: -20}}
      carton_2: {{kind: carton, size_m: [0.16, 0.07, 0.2], seed: 7, at_m: [-0.01, 0.0]}}
      carton_3: {{kind: carton, size_m: [0.16, 0.07, 0.2], seed: 8, at_m: [0.21, 0.05], yaw_deg: 20}}
      carton_4: {{kind: carton, size_m: [0.16, 0.07, 0.2], seed: 9, at_m: [0.43, 0.0], yaw_deg: 40}}
    lamps: [{{direction: [0.45, 0.55, -1.0], strength: 0.6}}]
  capture: {{rule: reference.photograph, world: $world, seed: 7}}
  beside: {{rule: reference.move_camera, world: $world, shift_m: [0.09, -0.03, 0.02], turn_deg: [1, -4, 1]}}
  image: {{rule: reference.photograph, world: $beside, seed: 3}}
  made: {{rule: reference.pixels_as_splats, capture: $image, scale_factor: {FACTOR}}}
targets: {{default: [made, capture, image, beside, world]}}
"""


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_generated_room_gets_the_scale_and_the_place_of_the_capture(tmp_path: Path) -> None:
    (tmp_path / "dxb.toml").write_text("")
    (tmp_path / "recipes").mkdir()
    (tmp_path / "recipes" / "generator.yaml").write_text(GENERATOR)
    project = Project.find(tmp_path)
    source = project.build("generator", profile="cpu")
    assert source.ok, source.errors
    tabletops.write(source.artifact("capture"), tmp_path / "shot")
    tabletops.write(source.artifact("image"), tmp_path / "image", measured=False)
    inputs = {name: str(tmp_path / folder) for name, folder in (("capture", "shot"), ("image", "image"))}
    inputs["generated"] = str(source.paths["made"])
    built = project.build("twin/generated_room:aligned", inputs=inputs, profile="cpu")
    assert built.ok, built.errors
    fit: SceneFit = built.artifact("fit")
    assert fit.motion.scale == pytest.approx(1 / FACTOR, rel=0.005)
    worlds = [source.artifact(name).camera_pose.matrix for name in ("world", "beside")]
    true = transforms.invert(worlds[0]) @ worlds[1]
    assert np.linalg.norm(fit.motion.matrix[:3, 3] - true[:3, 3]) < 0.008
    aligned: AlignedScene = built.artifact("aligned")
    assert aligned.splats is not None
    assert aligned.frame == aligned.splats.frame == "world"
    # The table that they show is the plane z = 0 of the twin.
    low = aligned.splats.means[:, 2]
    near = np.abs(low) < 0.05
    assert near.mean() > 0.3
    assert abs(float(np.median(low[near]))) < 0.003
