"""twin/tabletop from a picture and its intrinsics, without depth, on the CPU."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests import factories, tabletops
from tests.e2e.space import Answer, Space

SIZE = (0.1, 0.06, 0.14)
PLACES = {"near": factories.pose(-0.1, -0.08, yaw=0.3), "far": factories.pose(0.12, 0.1, yaw=-0.4)}
COLOURS = {"near": (0.75, 0.1, 0.1), "far": (0.15, 0.2, 0.7)}
PITCH_DEG = float(np.degrees(np.arcsin(-tabletops.EYE[2, 2])))
HEIGHT_M = float(tabletops.EYE[2, 3])
SETTINGS = (f"support.pitch_deg={PITCH_DEG}",)
TASK = """
summary: A task on this twin.
extends: task/line
inputs: {{capture: shot, description: scene.yaml, robot: robot/kuka_leap}}
nodes:
  twin: {{recipe: twin/tabletop, capture: $capture, description: $description}}
  base: {{rule: align.base, support: $twin.ground, position_m: [0.3, 0.4, 0.0]}}
  task:
    {{rule: simulate.task, scene: $twin.scene, assets: $twin.body.asset, robot: $robot, base: $base, {options}}}
  reference: {{rule: simulate.perturbed, bundle: $task}}
  view: {{rule: simulate.view, scene: $twin.scene}}
  cell: {{rule: simulate.cell, scene: $twin.scene, assets: $twin.body.asset, base: $base}}
targets: {{default: [task]}}
"""


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    things = [(tabletops.box(*SIZE, COLOURS[name]), place) for name, place in PLACES.items()]
    scene = tabletops.tabletop(*things, half=0.8, noise=0.0, lens=tabletops.FINE)
    (tmp_path / "shot").mkdir()
    photograph = scene.capture.photograph
    Image.fromarray(photograph.rgb.pixels).save(tmp_path / "shot/rgb.png")
    (tmp_path / "shot/capture.json").write_text(json.dumps(photograph.camera.model_dump()))
    lines = []
    for number, name in enumerate(PLACES, start=1):
        rows, columns = np.nonzero(scene.labels.labels == number)
        box = [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]
        lines.append(f"- {{name: {name}, category: box, material: cardboard, box: {box}}}\n")
    made.write("scene.yaml", "elements:\n" + "".join(lines))
    return made


def build(space: Space, recipe: str, *settings: str, profile: str = "picture", prefix: str = "") -> Answer:
    words = ["--profile", profile]
    words += [word for setting in (*SETTINGS, *settings) for word in ("--set", prefix + setting)]
    if not prefix:
        words += ["--input", "capture=shot", "--input", "description=scene.yaml"]
    return space.build(recipe, *words)


def got(space: Space, node: str, file: str, *settings: str) -> dict:
    words = ["--profile", "picture"]
    words += [word for setting in (*SETTINGS, *settings) for word in ("--set", setting)]
    words += ["--input", "capture=shot", "--input", "description=scene.yaml", "--out", "got"]
    answer = space.dxb("get", f"twin/tabletop:{node}", *words)
    assert answer.code == 0, answer.err
    found: dict = json.loads((space.root / "got" / file).read_text())
    return found


def place(space: Space, name: str, *settings: str) -> np.ndarray:
    return np.array(got(space, f"body[{name}].asset", "asset.pose.json", *settings)["matrix"])[:3, 3]


@pytest.mark.slow
def test_a_picture_becomes_a_twin_of_unknown_scale_and_one_size_gives_it_metres(space):
    answer = build(space, "twin/tabletop")
    assert answer.code == 0, answer.err[-3000:]
    lines = {event["node"]: event["line"] for event in answer.events if event["event"] == "node_finished"}
    assert lines["photo"] == "640 x 480 px, no depth"
    assert lines["scene"].endswith("scale unknown")
    assert lines["ground"] == "scale unknown"
    assert all("rgb, scale unknown" in lines[f"body[{name}].asset"] for name in PLACES)
    assert got(space, "body[near].asset", "asset.json")["scale"] == "unknown"
    report = space.dxb("report", "twin/tabletop", "-o", "page.html")
    assert report.code == 0, report.err
    page = (space.root / "page.html").read_text()
    assert '<span class="verdict warn">scale unknown</span>' in page
    assert "<dt>assets made from</dt><dd>rgb</dd>" in page

    sized = ("ground.object=near", f"ground.size_m={SIZE[2]}")
    metric = build(space, "twin/tabletop", *sized)
    assert metric.code == 0, metric.err[-3000:]
    # Nothing of a photograph is made again for a size that was stated later.
    ran = metric.nodes("ran")
    assert ran == {"ground", "composed", "scene", "usd", "settle", "overlay"} | {
        f"body[{name}].{node}" for name in PLACES for node in ("physics", "asset", "urdf")
    }
    # Against the truth: height of the camera, and how far apart the boxes stand.
    ground = np.array(got(space, "ground", "ground.camera_pose.json", *sized)["matrix"])
    assert ground[2, 3] == pytest.approx(HEIGHT_M, rel=0.02)
    apart = place(space, "far", *sized) - place(space, "near", *sized)
    true = PLACES["far"][:3, 3] - PLACES["near"][:3, 3]
    assert np.linalg.norm(apart) == pytest.approx(float(np.linalg.norm(true)), rel=0.05)


@pytest.mark.slow
def test_a_task_needs_to_know_the_scale(space):
    options = "name: Lift, primitive: lift, object: near, lift: {height_m: 0.1}"
    space.write("recipes/mine.yaml", TASK.format(options=options))
    refused = build(space, "mine", prefix="twin/")
    assert refused.code == 1
    (error,) = [event["error"] for event in refused.events if event.get("error")]
    assert error["message"] == "the scale of this twin is unknown, so no task can be built on it"
    assert "`size_m` of `align.scale`" in error["hint"]
    known = build(space, "mine", "ground.object=near", f"ground.size_m={SIZE[2]}", prefix="twin/")
    assert known.code == 0, known.err[-3000:]


@pytest.mark.slow
def test_what_needs_depth_says_which_profile_does_not(space):
    answer = build(space, "twin/tabletop", profile="cpu")
    assert answer.code == 1
    errors = [event["error"] for event in answer.events if event.get("error")]
    assert {error["message"] for error in errors} == {
        "this backend makes assets with the help of measured depth, but the capture has no depth"
    }
    assert "`--profile picture`" in errors[0]["hint"]
