"""Generators in environments of their own: the real programs, with stand-ins for the modules of the repositories."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import MachineError, RuleError
from dextera_build.testing import RuleRunner
from tests import factories
from tests.rules.factorize.shapes import generators

RULES = Path(__file__).parents[4] / "rules"
WEIGHTS = {
    "trellis2": {"trellis2": ["pipeline.json"]},
    "hunyuan3d_2_1": {
        "hunyuan3d_2_1": ["hunyuan3d-dit-v2-1/config.yaml", "hunyuan3d-paintpbr-v2-1/model_index.json"],
        "dinov2_giant": ["config.json"],
    },
    "sam3d_objects": {"sam3d_objects": ["checkpoints/pipeline.yaml"], "moge_vitl": ["model.pt"]},
}
MODULES = {"trellis2": generators.TRELLIS, "hunyuan3d_2_1": generators.HUNYUAN, "sam3d_objects": generators.SAM3D}


def view() -> ObjectView:
    mask = np.zeros((60, 40), bool)
    mask[8:52, 10:30] = True
    pixels = np.where(mask[..., None], (200, 60, 40), 90).astype(np.uint8)
    camera = factories.camera(40, 60)
    return ObjectView(
        rgb=Image(pixels=pixels), mask=mask, occluder=np.zeros_like(mask), camera=camera, phrase="red can"
    )


def runner(tmp_path: Path, name: str, gpu_gb: float = 80.0) -> RuleRunner:
    weights = {}
    for model, files in WEIGHTS[name].items():
        weights[model] = tmp_path / "weights" / model
        for file in files:
            path = weights[model] / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(file)
    return RuleRunner(tmp_path / "scratch", project=tmp_path, weights=weights, gpu_gb=gpu_gb)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if number else []) for number, name in enumerate(WEIGHTS)]
)
def test_a_closed_standing_mesh_is_made_of_the_picture_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / "scratch").mkdir()
    generators.environment(tmp_path, name, MODULES[name])
    shape: Shape = runner(tmp_path, name).run("factorize.mesh", backend=name, view=view())
    assert shape.mesh.is_closed
    assert (shape.asset_source, shape.hypothesis, shape.pose) == ("rgb", name, None)
    assert np.allclose(shape.mesh.extent, (0.6, 0.6, 0.9), atol=0.01)
    assert abs(float(shape.mesh.vertices[:, 2].min())) < 1e-5


@pytest.mark.parametrize("name", WEIGHTS)
def test_what_the_machine_lacks_is_told_with_the_next_step(tmp_path: Path, name: str) -> None:
    (tmp_path / "scratch").mkdir()
    with pytest.raises(MachineError) as caught:
        runner(tmp_path, name, gpu_gb=8.0).run("factorize.mesh", backend=name, view=view())
    assert f"backend `{name}` of factorize.mesh is missing" in caught.value.message
    needs = str(caught.value.facts["needs"])
    assert "a GPU with" in needs
    assert f".envs/{name}" in needs


@pytest.mark.slow
def test_the_mesh_of_sam_3d_objects_is_reduced_and_keeps_its_colours(tmp_path: Path) -> None:
    (tmp_path / "scratch").mkdir()
    generators.environment(tmp_path, "sam3d_objects", generators.SAM3D)
    options = {"sam3d_objects": {"faces": 2000}}
    shape: Shape = runner(tmp_path, "sam3d_objects").run(
        "factorize.mesh", backend="sam3d_objects", options=options, view=view()
    )
    mesh = shape.mesh
    assert mesh.is_closed
    assert 1000 < len(mesh.faces) <= 2000
    heights = mesh.vertices[mesh.faces].mean(axis=1)[:, 2]
    red, _, blue = baked(mesh).T
    # Few faces reach across the middle of the flat sides.
    assert np.mean(red[heights > 0.5] > blue[heights > 0.5]) > 0.9
    assert np.mean(red[heights < 0.4] < blue[heights < 0.4]) > 0.9


def baked(mesh: Mesh) -> np.ndarray:
    """Colours of the texture in the middle of each face, (F, 3)."""
    assert mesh.texture is not None
    assert mesh.uv is not None
    pixels = mesh.texture.pixels
    column, row = (mesh.uv.mean(axis=1) * pixels.shape[1::-1]).astype(int).T
    return np.asarray(pixels[pixels.shape[0] - 1 - row, column]).astype(int)


@pytest.mark.medium
def test_sam_3d_objects_downloads_nothing_and_says_what_is_missing(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "scratch").mkdir()
    generators.environment(tmp_path, "sam3d_objects", generators.SAM3D)
    monkeypatch.setenv("DXB_TEST_NO_DINO", "1")
    with pytest.raises(RuleError) as caught:
        runner(tmp_path, "sam3d_objects").run("factorize.mesh", backend="sam3d_objects", view=view())
    assert "dinov2.zip is not in the folder of torch.hub" in caught.value.message
    assert "torch.hub.load" in str(caught.value.hint)
