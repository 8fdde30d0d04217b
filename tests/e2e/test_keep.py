"""`ctx.keep`: a call that was cut off goes on from what it saved; what is saved reaches no key and no result."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.e2e.space import Answer, Space

TRAIN = '''
"""toy.train: counts how often it was started, and stumbles the first time."""
import os
import signal
import time
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class TrainOptions(Options):
    """Options."""
    first: str = "pass"
    """What happens the first time."""
    rate: float = 0.1
    """A number."""

@rule(version=1)
def train(ctx: Context, text: File, *, options: TrainOptions) -> File:
    """Return the text."""
    saved = ctx.keep / "starts"
    starts = int(saved.read_text()) + 1 if saved.exists() else 1
    aside = ctx.keep / "aside"
    aside.write_text(str(starts))
    aside.rename(saved)
    if starts == 1 and options.first == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if starts == 1 and options.first == "wait":
        print("waits", flush=True)
        time.sleep(60)
    ctx.check(starts > 1 or options.first != "fail", "not yet")
    ctx.say(f"start {starts}")
    return text
'''
RECIPE = """nodes:
  start: {rule: toy.start}
  trained: {rule: toy.train, text: $start, first: %s}
  after: {rule: toy.shout, text: $trained}
targets: {default: [after]}
"""


@pytest.fixture
def training(space: Space) -> Space:
    space.write("rules/toy/train.py", TRAIN.lstrip())
    return space


def kept(space: Space) -> list[Path]:
    folder = space.root / "cache" / "local" / "keep"
    return list(folder.iterdir()) if folder.is_dir() else []


def finished(answer: Answer, node: str) -> dict:
    (event,) = [e for e in answer.events if e["event"] == "node_finished" and e["node"] == node]
    return event


def assert_goes_on(space: Space) -> None:
    (folder,) = kept(space)
    assert (folder / "starts").read_text() == "1"
    again = space.build("say/train")
    assert again.code == 0, again.err
    assert again.nodes("cached") == {"start"}
    trained = finished(again, "trained")
    assert (trained["line"], trained["key"]) == ("start 2", folder.name)
    # The text comes out as it went in: nothing of the stumble is in the result.
    assert trained["output"] == finished(again, "start")["output"]
    assert kept(space) == []


def wait_for_start(space: Space) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not any((folder / "starts").exists() for folder in kept(space)):
        time.sleep(0.05)
    assert kept(space)


@pytest.mark.medium
@pytest.mark.parametrize(("first", "code"), [("kill", "B301"), ("fail", "B201")])
def test_a_call_whose_worker_was_killed_or_that_failed_goes_on(training, first, code):
    training.write("recipes/say/train.yaml", RECIPE % first)
    answer = training.build("say/train")
    assert answer.code == 1
    assert finished(answer, "trained")["error"]["code"] == f"DXB-{code}"
    assert_goes_on(training)


@pytest.mark.medium
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, *(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGINT, signal.SIGTERM))]
)
def test_a_build_that_was_ended_goes_on(training, how):
    training.write("recipes/say/train.yaml", RECIPE % "wait")
    process = training.start("build", "say/train", start_new_session=True)
    wait_for_start(training)
    process.send_signal(how)
    process.communicate(timeout=40)
    assert process.returncode == {signal.SIGINT: 130, signal.SIGTERM: 143}.get(how, -how)
    assert_goes_on(training)


def test_a_call_that_passes_at_once_leaves_nothing(training):
    training.write("recipes/say/train.yaml", RECIPE % "pass")
    answer = training.build("say/train")
    assert answer.code == 0
    assert finished(answer, "trained")["line"] == "start 1"
    assert kept(training) == []


@pytest.mark.medium
def test_another_key_begins_anew(training):
    training.write("recipes/say/train.yaml", RECIPE % "fail")
    assert training.build("say/train").code == 1
    assert training.build("say/train", "--set", "trained.rate=0.2").code == 1
    assert [(folder / "starts").read_text() for folder in kept(training)] == ["1", "1"]


def test_force_begins_anew(training):
    training.write("recipes/say/train.yaml", RECIPE % "fail")
    assert training.build("say/train").code == 1
    assert training.build("say/train", "--force", "trained").code == 1
    assert_goes_on(training)


@pytest.mark.medium
def test_check_of_a_node_has_a_fresh_folder(training):
    training.write("recipes/say/train.yaml", RECIPE % "fail")
    assert training.build("say/train").code == 1
    assert_goes_on(training)
    answer = training.dxb("check", "say/train:trained")
    assert answer.code == 1
    assert "error[DXB-B201]: not yet" in answer.err
    assert kept(training) == []


def test_cache_shows_what_is_kept(training):
    training.write("recipes/say/train.yaml", RECIPE % "fail")
    assert training.build("say/train").code == 1
    assert "keep\t1\t1\n" in training.dxb("cache", "size").out
