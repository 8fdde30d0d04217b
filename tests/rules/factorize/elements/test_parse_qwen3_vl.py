"""The backend `qwen3_vl` with a tiny model of the same class, and its questions with constructed answers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.rule.pretrained import unload
from dextera_build.testing import RuleRunner
from tests import factories, tabletops
from tests.installed import needs

from . import tiny_qwen3_vl
from .test_parse_vlm import MUG

needs("transformers")


@pytest.fixture(scope="module", autouse=True)
def unloaded():
    yield
    unload()


@pytest.fixture(scope="module")
def shot():
    scene = tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, (0.75, 0.1, 0.1)), factories.pose(0, 0)))
    return factories.shot(scene.capture)["photograph"]


@pytest.fixture(scope="module")
def knowing(tmp_path_factory):
    text = "```json\n" + json.dumps({"elements": [{**MUG, "box": [100, 250, 500, 1000]}]}) + "\n```"
    return tiny_qwen3_vl.save(tmp_path_factory.mktemp("knowing"), text)


@pytest.fixture(scope="module")
def speaker(knowing):
    from dextera_build.learning.qwen3_vl import Speaker

    return Speaker.load(knowing, "cpu")


def parse(folder, weights, shot, **options):
    runner = RuleRunner(folder, weights={"qwen3_vl": weights})
    return runner, runner.run("factorize.parse", backend="qwen3_vl", options={"qwen3_vl": options}, photograph=shot)


@pytest.mark.medium
def test_things_come_from_the_model_with_boxes_in_thousandths(tmp_path, knowing, shot):
    runner, found = parse(tmp_path, knowing, shot, picture_tokens=64)
    rows, columns = shot.rgb.pixels.shape[:2]
    mug, table = found.elements
    assert (mug.name, mug.material, table.name) == ("red_mug", "ceramic", "support")
    assert mug.box == (int(0.1 * columns), int(0.25 * rows), round(0.5 * columns), rows)
    assert found.asset_source == "rgb"
    again = parse(tmp_path / "again", knowing, shot, picture_tokens=64)[1]
    assert runner.encode(again) == runner.encode(found)


def test_a_model_that_never_answers_the_question_is_an_error(tmp_path, shot):
    weights = tiny_qwen3_vl.save(tmp_path / "weights", "I see a red mug.")
    with pytest.raises(RuleError, match="the model gives no usable answer") as caught:
        parse(tmp_path, weights, shot, picture_tokens=16, attempts=2)
    assert caught.value.code == "DXB-B355"
    assert caught.value.facts == {"asked": "2 times", "it said": "I see a red mug."}
    assert "scene.yaml" in caught.value.hint


def test_the_model_is_told_what_is_wrong_and_answers_again():
    from rules.factorize.elements.parse_qwen3_vl import ask

    wrong = json.dumps({"elements": [{**MUG, "box": [60, 20, 1001, 90]}]})
    answers, heard = [wrong, "nonsense", json.dumps({"elements": [MUG]})], []

    def say(chat):
        heard.append(chat)
        return answers[len(heard) - 1]

    assert ask(say, 3).elements[0].name == "red_mug"
    first, second, third = heard
    assert [role for role, _ in first] == ["user"]
    assert "1000 units wide and 1000 units high" in first[0][1]
    assert '"additionalProperties": false' in first[0][1]
    assert second[:2] == [*first, ("assistant", wrong)]
    assert "[60, 20, 1001, 90], outside of the picture of 1000 × 1000 units" in second[2][1]
    assert third[:2] == [*first, ("assistant", "nonsense")]


def test_the_picture_becomes_as_many_tokens_as_the_template_holds(speaker):
    chat = [("user", "what?"), ("assistant", "that"), ("user", "again")]
    inputs = speaker.inputs(np.zeros((480, 640, 3), np.uint8), chat, 48)
    (grid,) = inputs["image_grid_thw"].tolist()
    assert grid == [1, 12, 16]  # 192 × 256 px keep the ratio and are 48 tokens of 32 × 32 px
    assert int(inputs["mm_token_type_ids"].sum()) == 48
    assert inputs["pixel_values"].shape == (12 * 16, 3 * 2 * 16 * 16)
    said = speaker.tokenizer.decode(inputs["input_ids"][0])
    assert said.startswith("<|im_start|>user\n<|vision_start|><|image_pad|><|image_pad|>")
    assert said.endswith("<|vision_end|>what?<|im_end|>\n<|im_start|>assistant\nthat<|im_end|>\n"
                         "<|im_start|>user\nagain<|im_end|>\n<|im_start|>assistant\n")  # fmt: skip


def test_pixels_are_scaled_as_the_saved_numbers_say(speaker):
    for level in (0, 51, 255):
        seen = speaker.inputs(np.full((64, 64, 3), level, np.uint8), [("user", "?")], 4)["pixel_values"]
        assert seen.numpy() == pytest.approx(np.full(seen.shape, (level / 255 - 0.5) / 0.5), abs=1e-6)


@pytest.mark.medium
def test_the_template_may_be_in_a_file_of_its_own(tmp_path, knowing):
    import shutil

    from dextera_build.learning.qwen3_vl import Speaker

    folder = shutil.copytree(knowing, tmp_path / "old")
    (folder / "chat_template.jinja").unlink()
    (folder / "chat_template.json").write_text(json.dumps({"chat_template": "{{ messages[0].role }} asks"}))
    assert Speaker.load(folder, "cpu").tokenizer.chat_template == "{{ messages[0].role }} asks"
