"""The task gallery: what is to be done, a film that plays, and how often it was done, in every world."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.tasks.episode import Film
from dextera_build.formats import video
from dextera_build.report.details import details
from dextera_build.report.films import Films
from dextera_build.report.pictures import LADDER, Pictures
from dextera_build.report.run import Node, Run
from dextera_build.report.sources import header
from dextera_build.report.tasks import cards
from tests import episodes, series
from tests.report.fabricate import FakeStore

STEPS = 9


def node(store: FakeStore, address: str, rule: str, made: Artifact, inputs: dict[str, str] | None = None) -> Node:
    output = made.encode(store.blobs.put)
    kind, fields = header(store, output)
    return Node(
        index=0,
        address=address,
        rule=rule,
        backend=None,
        status="ran",
        key=None,
        output=output,
        began=0.0,
        ended=1.0,
        inputs=inputs or {},
        artifact=kind,
        fields=fields,
    )


@pytest.fixture
def run() -> tuple[Run, FakeStore]:
    store = FakeStore()
    bundle, shown = episodes.bundle(), episodes.small(18, STEPS).model_copy(update={"attempts": 20})
    robot = node(store, "robot/three_joints:robot", "simulate.robot", bundle.robot)
    task = node(store, "task", "simulate.task", bundle)
    other = node(store, "reference", "reference.task", bundle.model_copy(update={"kind": "reference"}))
    sources = node(store, "sources", "demonstrate.operate", shown, {"bundle": task.output or ""})
    pixels = np.zeros((STEPS, 48, 65, 3), np.uint8)
    pixels[:, :, :, 0] = np.linspace(0, 200, STEPS).astype(np.uint8)[:, None, None]
    film = Film(frames={"10": b"", "9": Film.packed(pixels)}, width=65, height=48)
    filmed = node(store, "film", "demonstrate.film", film, {"bundle": task.output or ""})
    trials = node(
        store,
        "act_reference",
        "evaluate.rollouts",
        series.trials([True, False, True, True], label="ACT", world="reference"),
        {"bundle": other.output or ""},
    )
    return Run(nodes=[robot, other, task, sources, filmed, trials]), store


def test_a_task_has_one_card_with_its_film_and_its_rates(run: tuple[Run, FakeStore]) -> None:
    import av

    (card,) = cards(run[0], Pictures(run[1], LADDER[0]), Films(run[1]))
    words = re.sub(r"<[^>]*>", " ", card)
    assert "LiftBox" in words
    facts = dict(re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", card))
    assert (facts["primitive"], facts["object"], facts["robot"]) == ("lift", "box", "three_joints")
    assert facts["worlds"] == "twin, reference"
    assert re.search(r"scripted operator\s+twin\s+18/20\s+70–97 %", words)
    assert re.search(r"ACT\s+reference\s+3/4\s+30–95 %\s+progress 88 %", words)
    (data,) = re.findall(r'<video src="data:video/mp4;base64,([^"]*)"', card)
    with av.open(io.BytesIO(base64.b64decode(data))) as opened:
        frames = [frame.to_ndarray(format="rgb24") for frame in opened.decode(video=0)]
    assert (len(frames), frames[0].shape) == (STEPS, (48, 64, 3))
    assert abs(float(frames[-1][..., 0].mean()) - 200) < 6
    (video,) = re.findall(r"<video[^>]*>", card)
    assert {"autoplay", "loop", "muted", "playsinline", "controls"} <= set(video.split())
    assert "max-width:130px" in video  # 65 px would else be blown up to the width of the card


def test_hands_are_not_called_a_script(run: tuple[Run, FakeStore]) -> None:
    made, store = run
    made.nodes[3].inputs = {**made.nodes[3].inputs, "recording": "a digest"}
    (card,) = cards(made, Pictures(store, LADDER[0]), None)
    assert re.search(r"operator(?:'|&#x27;|&#39;)s hands\s+twin\s+18/20", re.sub(r"<[^>]*>", " ", card))
    assert "scripted" not in card


def test_without_films_and_pictures_the_facts_stay(run: tuple[Run, FakeStore]) -> None:
    made, store = run
    damaged = json.loads(json.dumps(made.nodes[4].fields))
    damaged["frames"] = {"$map": {"0": {"$bytes": [store.blobs.put(b"no film"), 7]}}}
    made.nodes[4].fields = damaged
    for films in (None, Films(store)):
        (card,) = cards(made, Pictures(store, LADDER[0]), films)
        assert "<video" not in card
        assert "LiftBox" in card


def test_a_run_without_tasks_has_no_gallery() -> None:
    nothing: Any = FakeStore()
    assert cards(Run(), Pictures(nothing, LADDER[0]), None) == []


def test_a_result_that_is_a_small_mp4_is_shown_with_its_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = np.random.default_rng(0).integers(0, 255, (6, 48, 64, 3), np.uint8)
    made = video.write(tmp_path / "a.mp4", frames, video.encoder(64, 48, 12.0))
    store = FakeStore()
    run = Run(nodes=[node(store, "film", "capture.hands_film", made)])
    shown = details(run, Pictures(store, LADDER[0]), Films(store))
    (data,) = re.findall(r'<video src="data:video/mp4;base64,([^"]*)"', shown)
    assert base64.b64decode(data) == made.file.data
    assert "<video" not in details(run, Pictures(store, LADDER[0]))
    monkeypatch.setattr("dextera_build.report.films.MOST_BYTES", len(made.file.data) - 1)
    assert "<video" not in details(run, Pictures(store, LADDER[0]), Films(store))
