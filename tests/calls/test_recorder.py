"""Requests are canonical and contain no secrets; each is sent once, with retries and backoff."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import replace
from email.utils import formatdate
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.calls import Response, asking
from dextera_build.calls.question import question
from dextera_build.calls.recorder import Recorder
from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text()
    | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(min_size=1).filter(lambda name: name[0] != "$"), inner, max_size=3)
    ),
    max_leaves=10,
)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


def turned(value):
    """The same value with every dict in another order and every list a tuple."""
    if isinstance(value, dict):
        return {name: turned(value[name]) for name in reversed(value)}
    return tuple(map(turned, value)) if isinstance(value, list) else value


@settings(deadline=None)
@given(PLAIN)
def test_one_request_has_one_key(request_):
    assert question("s", request_).key == question("s", turned(request_)).key
    assert question("s", request_).key != question("t", request_).key
    assert question("s", [request_]).key != question("s", request_).key


@settings(deadline=None)
@given(st.binary(), st.binary())
def test_attached_bytes_count(one, other):
    keys = {question("s", {"picture": data}).key for data in (one, other)}
    assert len(keys) == len({one, other})


@pytest.mark.parametrize(
    ("request_", "place"),
    [
        ({"a": [1.0, float("nan")]}, "request.a[1]"),
        ({"a": object()}, "request.a"),
        ({"a": {1: 2}}, "request.a[1]"),
        ({"$bytes": ["00", 1]}, "request['$bytes']"),
    ],
)
def test_what_is_not_plain_is_refused_by_place(request_, place):
    with pytest.raises(RuleError) as caught:
        question("s", request_)
    assert caught.value.code == "DXB-B342"
    assert f"`{place}` of a call" in caught.value.message


@pytest.mark.parametrize("request_", [{"header": "Bearer geheim-geheim"}, {"file": b"..geheim-geheim.."}])
def test_a_request_with_a_secret_is_refused(store, monkeypatch, request_):
    monkeypatch.setenv("TOY_API_KEY", "geheim-geheim")
    with pytest.raises(RuleError, match="holds the value of `TOY_API_KEY`, which would be kept") as caught:
        Recorder(store, "record")("s", request_, lambda seconds: b"")
    assert caught.value.code == "DXB-B343"
    assert "geheim" not in json.dumps(caught.value.to_json())
    monkeypatch.delenv("TOY_API_KEY")
    with pytest.raises(RuleError, match="holds a secret"):
        Recorder(store, "record")("s", request_, lambda seconds: b"", secrets=("geheim-geheim",))


def test_errors_of_send_hide_secrets(store, monkeypatch):
    monkeypatch.setenv("TOY_API_KEY", "geheim-geheim")

    def send(seconds):
        raise ValueError("https://x/?key=geheim-geheim")

    with pytest.raises(RuleError, match="ValueError: https://x/\\?\\*\\*\\*") as caught:
        Recorder(store, "record")("s", {}, send)
    assert caught.value.__cause__ is None


def test_threads_with_one_request_ask_once(store):
    asked, got = [], []

    def send(seconds):
        asked.append(seconds)
        time.sleep(0.05)
        return b"yes"

    threads = [
        threading.Thread(target=lambda: got.append(Recorder(store, "record")("s", {"q": 1}, send))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert got == [b"yes"] * 8
    assert len(asked) == 1


@pytest.mark.parametrize("date", [False, True])
def test_a_service_is_left_alone_as_long_as_it_says(store, monkeypatch, date):
    rests = []
    monkeypatch.setattr(asking.time, "sleep", rests.append)
    after = formatdate(time.time() + 7, usegmt=True) if date else "7"
    answers = [Response(b"", 429, {"retry-after": after}), Response(b"yes")]
    assert Recorder(store, "record")("s", {}, lambda seconds: answers.pop(0)) == b"yes"
    assert rests == [pytest.approx(7, abs=2)]


def test_one_that_wants_to_be_left_alone_for_long_is_given_up(store, monkeypatch):
    monkeypatch.setattr(asking.time, "sleep", lambda seconds: pytest.fail("it waits"))
    with pytest.raises(MachineError) as caught:
        Recorder(store, "record")("s", {}, lambda seconds: Response(b"", 429, {"Retry-After": "3600"}))
    assert caught.value.code == "DXB-E360"
    assert caught.value.facts["asks to wait"] == "3600 s"
    assert caught.value.facts["tries"] == "1"


def test_rests_grow(store, monkeypatch):
    rests = []
    monkeypatch.setattr(asking.time, "sleep", rests.append)

    def send(seconds):
        raise ConnectionResetError("by peer")

    with pytest.raises(DxbError, match="cannot be reached: ConnectionResetError: by peer"):
        Recorder(store, "record")("s", {}, send, tries=5, wait_s=1.0)
    assert len(rests) == 4
    assert all(later == pytest.approx(2 * rest) for rest, later in pairwise(rests))


def test_a_record_is_a_result_that_a_remote_would_take(store):
    recorder = Recorder(store, "record")
    recorder("s", {"q": 1}, lambda seconds: b'{"usage": {"input_tokens": 3, "cost": 0.5}}')
    (made,) = recorder.made
    assert made["cost"] == 0.5
    result = store.actions.known(made["call"])
    assert result is not None
    assert result.is_record
    assert result.metrics["prompt_tokens"] == (3.0, "tokens")
    assert store.actions.get(made["call"])
    assert b'"calls"' not in result.document


def test_a_result_brings_its_calls_and_no_others(store, tmp_path):
    recorder = Recorder(store, "record")
    recorder("s", {"q": 1}, lambda seconds: b"yes")
    (made,) = recorder.made
    called = store.actions.get(made["call"])
    document = store.blobs.put(b"{}")
    result = replace(called, key_document=document, calls=((made["call"], made["result"]),))
    (store.actions.root / made["call"][:2] / made["call"][2:]).unlink()
    store.actions.put(document, result)
    assert store.actions.get(made["call"]) == called
    found = store.actions.entry(document)
    assert {("beside", made["call"]), ("beside", made["result"])} <= {file[:2] for file in found.files}
    other = "ab" * 32
    with pytest.raises(ValueError, match="digest that is its key"):
        store.actions.put(document, replace(result, calls=((other, made["result"]),)))
    assert store.actions.get(other) is None


def test_a_record_from_elsewhere_has_the_right_form(store):
    recorder = Recorder(store, "record")
    recorder("s", {"q": 1}, lambda seconds: b"yes")
    right = json.loads(store.blobs.get(recorder.made[0]["result"]))
    assert is_record(json.dumps(right).encode())
    wrong = [
        {"line": 3},
        {"metrics": []},
        {"metrics": {"cost": ["1", "USD"]}},
        {"calls": []},
        {"output": "../x"},
        {"log": "a" * 64},
    ]
    for change in wrong:
        assert not is_record(json.dumps(right | change).encode())
    assert not is_record(b"[]")
    assert not is_record(b"<html>")


def is_record(document: bytes) -> bool:
    try:
        return ActionResult.from_document(document).is_record
    except ValueError:
        return False
