"""The backend `vlm` against a chat endpoint on this machine, and offline against what it answered."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.base import File
from dextera_build.calls.recorder import Recorder
from dextera_build.errors import DxbError
from dextera_build.store.store import Store
from dextera_build.testing import RuleRunner
from tests import factories, tabletops
from tests.calls.services import KEY, serving

MUG = {
    "name": "red_mug",
    "phrase": "red mug",
    "category": "mug",
    "body_type": "rigid",
    "interactive": True,
    "material": "ceramic",
    "mass_g": [250, 400],
    "friction": [0.3, 0.5],
    "restitution": [0.2, 0.5],
    "box": [10, 20, 60, 90],
}


@pytest.fixture(scope="module")
def scene():
    return tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, (0.75, 0.1, 0.1)), factories.pose(0, 0)))


@pytest.fixture
def service(monkeypatch):
    with serving() as made:
        monkeypatch.setenv("DXB_VLM_URL", made.url)
        monkeypatch.setenv("DXB_VLM_API_KEY", KEY)
        made.content = json.dumps({"elements": [MUG]})
        yield made


@pytest.fixture(scope="module")
def support(scene, tmp_path_factory):
    return RuleRunner(tmp_path_factory.mktemp("support")).run("align.support", **factories.shot(scene.capture))


@pytest.fixture
def parse(tmp_path, scene, support):
    def run(mode="record", **options):
        runner = RuleRunner(tmp_path, calls=Recorder(Store(tmp_path / "store"), mode))
        return runner.run(
            "factorize.parse",
            backend="vlm",
            options={"vlm": {"model": "seer-1", **options}},
            **factories.shot(scene.capture),
            support=support,
        )

    return run


@pytest.mark.medium
def test_things_come_from_the_service_and_then_from_the_record(parse, service, scene, monkeypatch):
    found = {element.name: element for element in parse().elements}
    assert set(found) == {"red_mug", "support"}
    assert found["red_mug"].box == (10, 20, 60, 90)
    estimate = found["red_mug"].estimate
    assert (estimate.phrase, estimate.mass_kg, estimate.friction) == ("red mug", (0.25, 0.4), (0.3, 0.5))
    assert found["support"].estimate is None
    monkeypatch.delenv("DXB_VLM_URL")
    again = parse("replay")
    assert again.elements[0] == found["red_mug"]
    (asked,) = service.asked
    assert asked["path"] == "/v1/chat/completions"
    assert asked["key"] == f"Bearer {KEY}"
    assert asked["model"] == "seer-1"
    picture = asked["messages"][0]["content"][1]["image_url"]["url"].partition(",")[2]
    sent = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))))
    assert sent.shape == scene.capture.photograph.rgb.pixels.shape
    assert np.abs(sent.astype(int) - scene.capture.photograph.rgb.pixels).mean() < 3


@pytest.mark.medium
@pytest.mark.parametrize(
    "things",
    [
        [{**MUG, "box": [10, 20, 60, 100_000]}],
        [{**MUG, "box": [60, 20, 10, 90]}],
        [{**MUG, "box": [-1, 20, 60, 90]}],
        [{**MUG, "box": [10, 20, 60]}],
        [MUG, MUG],
        [{**MUG, "name": "support"}],
        [{**MUG, "name": "../red"}],
        [{**MUG, "category": "weapon"}],
        [{**MUG, "colour": "red"}],
        [{**MUG, "mass_g": [400, 250]}],
        [{**MUG, "mass_g": [0, 250]}],
        [{**MUG, "friction": [0.2, 3.0]}],
        [{**MUG, "restitution": [-0.1, 0.3]}],
        [{name: value for name, value in MUG.items() if name != "mass_g"}],
        [],
    ],
)
def test_an_answer_that_cannot_be_is_refused_and_not_recorded(parse, service, things, monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    service.content = json.dumps({"elements": things})
    with pytest.raises(DxbError, match="gives no usable answer") as caught:
        parse()
    assert caught.value.code == "DXB-B345"
    with pytest.raises(DxbError, match="no answer of") as caught:
        parse("replay")
    assert caught.value.code == "DXB-B340"


def test_the_key_does_not_go_to_another_machine_in_the_clear(parse, service, monkeypatch):
    monkeypatch.setenv("DXB_VLM_URL", "http://192.0.2.1/v1")
    with pytest.raises(DxbError, match="in the clear") as caught:
        parse()
    assert caught.value.code == "DXB-E363"


def test_without_an_address(parse, monkeypatch):
    monkeypatch.delenv("DXB_VLM_URL", raising=False)
    with pytest.raises(DxbError) as caught:
        parse()
    assert caught.value.code == "DXB-E362"


def test_the_model_is_told_what_is_wrong_and_answers_again(parse, service):
    service.contents = [json.dumps({"elements": [{**MUG, "box": [60, 20, 10, 90]}]}), service.content]
    assert {element.name for element in parse().elements} == {"red_mug", "support"}
    first, second = service.asked
    assert second["messages"][0] == first["messages"][0]
    assert second["messages"][1] == {
        "role": "assistant",
        "content": json.dumps({"elements": [{**MUG, "box": [60, 20, 10, 90]}]}),
    }
    assert "the box of `red_mug` is [60, 20, 10, 90]" in second["messages"][2]["content"]


def test_an_estimate_stays_with_an_element_that_the_file_only_renames(scene, support, service, tmp_path):
    """Another material makes it another thing than the one that the model weighed."""

    def cup(entry: str):
        runner = RuleRunner(tmp_path, calls=Recorder(Store(tmp_path / "store"), "record"))
        listed = File(data=f"elements:\n  - {{name: cup, at_px: [30, 40]{entry}}}\n".encode())
        shot = factories.shot(scene.capture)
        options = {"vlm": {"model": "seer-1"}}
        found = runner.run("factorize.parse", backend="vlm", options=options, **shot, support=support, scene=listed)
        return found.elements[0]

    assert cup("").estimate.mass_kg == (0.25, 0.4)
    assert cup(", material: metal").estimate is None
