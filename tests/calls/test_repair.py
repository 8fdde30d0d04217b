"""A model is told what is wrong with its answer, a bounded number of times, and only the good answer is recorded."""

from __future__ import annotations

import json

import pytest
from pydantic import BaseModel

from dextera_build.calls import Response
from dextera_build.calls.recorder import Recorder
from dextera_build.errors import RuleError
from dextera_build.store.store import Store


class Answer(BaseModel):
    """What the model has to say."""

    name: str
    size: int


class Model:
    """A model that gives these answers, and remembers what it was told."""

    def __init__(self, *answers):
        self.answers, self.told = list(answers), []

    def send(self, seconds):
        return self.answers.pop(0)

    def repair(self, body, why):
        def send(seconds):
            self.told.append((body, why))
            return self.answers.pop(0)

        return send


GOOD = b'{"name": "mug", "size": 3}'
BAD = b'{"name": "mug", "size": "large"}'


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


def ask(store, model, **manner):
    return Recorder(store, "record")(
        "chat", {}, model.send, valid=Answer.model_validate_json, repair=model.repair, wait_s=0.0, **manner
    )


def test_the_error_goes_back_to_the_model(store):
    model = Model(BAD, b"{}", GOOD)
    assert ask(store, model) == GOOD
    (first, why), (second, _) = model.told
    assert (first, second) == (BAD, b"{}")
    assert "size" in why  # the whole error, not its first line
    assert "valid integer" in why
    assert Recorder(store, "replay")("chat", {}, model.send) == GOOD


def test_repairs_are_bounded(store):
    model = Model(*[BAD] * 9)
    with pytest.raises(RuleError, match="gives no usable answer: 1 validation error for Answer") as caught:
        ask(store, model, repairs=3)
    assert caught.value.code == "DXB-B345"
    assert caught.value.facts["tries"] == "4"
    assert len(model.answers) == 5


def test_a_fault_of_the_network_during_a_repair_is_retried_as_a_repair(store):
    model = Model(BAD, Response(b"", 500), GOOD)
    assert ask(store, model) == GOOD
    assert [body for body, _ in model.told] == [BAD, BAD]


def test_secrets_in_errors_do_not_go_back(store, monkeypatch):
    monkeypatch.setenv("CHAT_API_KEY", "geheim-geheim")

    def valid(body):
        if json.loads(body)["size"] != 3:
            raise ValueError("called with geheim-geheim")

    model = Model(BAD, GOOD)
    Recorder(store, "record")("chat", {}, model.send, valid=valid, repair=model.repair)
    assert model.told == [(BAD, "called with ***")]
