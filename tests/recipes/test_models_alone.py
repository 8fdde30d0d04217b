"""twin/tabletop from a picture alone, with the models of the profiles `gpu` and `cloud`: their meshes, no depth.

The generator of `gpu` is the real program with stand-ins for the modules of its repository; the services of `cloud`
are servers on this machine that speak the documented protocols.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from dextera_build.models.folders import ModelFolders
from tests.calls.services import KEY, serving
from tests.recipes import test_photograph_alone as alone
from tests.recipes.test_photograph_alone import space as space
from tests.rules.factorize.shapes import generators
from tests.rules.factorize.shapes.tencent import SECRET_ID, SECRET_KEY, serving_tencent
from tests.rules.factorize.shapes.test_mesh_programs import WEIGHTS

INPUTS = ("--input", "capture=shot", "--input", "description=scene.yaml", "--set", *alone.SETTINGS)


def check(answer, made_by: str) -> None:
    assert answer.code == 0, answer.err[-3000:]
    lines = {event["node"]: event["line"] for event in answer.events if event["event"] == "node_finished"}
    assert lines["photo"].endswith("no depth")
    assert lines["scene"].endswith("scale unknown")
    meshes = [line for node, line in lines.items() if node.endswith(".mesh")]
    assert len(meshes) == len(alone.PLACES)
    assert all(line.startswith(made_by) and line.endswith(", rgb") for line in meshes), meshes


@pytest.mark.slow
def test_a_generator_on_a_gpu_makes_the_assets(space) -> None:
    name = "hunyuan3d_2_1"
    generators.environment(space.root, name, generators.HUNYUAN)
    folders = ModelFolders([space.root / ".cache/dxb/models"])
    for model, files in WEIGHTS[name].items():
        folders.install(model, lambda part, files=files: filled(part, files))
    assert space.dxb("models", "accept", name).code == 0
    words = ("--profile", "gpu", "--resources", "gpu=1,gpu_memory=40")
    others = ("factorize.parse=written", "factorize.segment=grabcut", "factorize.articulate=crease")
    others += ("factorize.complete=visible",)
    words += tuple(word for name in (*others, "background.static=planes") for word in ("--backend", name))
    answer = space.build("twin/tabletop", *words, *INPUTS)
    check(answer, name.replace("_", " "))


def filled(part: Path, files: list[str]) -> str:
    for file in files:
        path = part / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(file)
    return "a test"


@pytest.mark.slow
def test_services_make_the_assets_and_their_recorded_answers_make_them_again(space) -> None:
    pytest.importorskip("tencentcloud.ai3d")
    solid = trimesh.creation.box(np.array(alone.SIZE)[[0, 2, 1]] * 7.0)  # y up, in a unit of its own
    words = ("--profile", "cloud", "--input", "capture=shot", "--set", *alone.SETTINGS)
    words += ("--set", "parse.vlm.model=seer-1")
    with serving() as seer, serving_tencent(solid.export(file_type="glb")) as maker:
        seer.content = json.dumps({"elements": things(space.root / "scene.yaml")})
        keys = {"DXB_VLM_API_KEY": KEY, "TENCENTCLOUD_SECRET_ID": SECRET_ID, "TENCENTCLOUD_SECRET_KEY": SECRET_KEY}
        places = {"DXB_VLM_URL": seer.url, "DXB_HUNYUAN_URL": maker.url}
        answer = space.dxb(
            "build", "--console", "jsonl", "twin/tabletop", *words, env={**keys, **places, "DXB_CONSENT": "all"}
        )
        check(answer, "hunyuan3d 3.1")
        assert (len(seer.asked), len(maker.submitted)) == (1, len(alone.PLACES))
    nodes = [word for name in ("parse", "body.mesh") for word in ("--force", name)]
    again = space.dxb("build", "--console", "jsonl", *nodes, "twin/tabletop", *words, env={"DXB_CALLS": "replay"})
    check(again, "hunyuan3d 3.1")
    assert {"parse", *(f"body[{name}].mesh" for name in alone.PLACES)} <= again.nodes("ran")
    outputs = [
        {event["node"]: event["output"] for event in each.events if event["event"] == "node_finished"}
        for each in (answer, again)
    ]
    assert outputs[0] == outputs[1]


def things(scene: Path) -> list[dict[str, Any]]:
    """What the service answers: the elements of a `scene.yaml`."""
    contact = {"friction": [0.3, 0.5], "restitution": [0.1, 0.4]}
    facts = {"body_type": "rigid", "interactive": True, "mass_g": [100, 600], **contact}
    return [
        {**facts, "phrase": f"{told['name']} box", **told} for told in yaml.safe_load(scene.read_text())["elements"]
    ]
