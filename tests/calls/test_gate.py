"""Requests pass the limits of their service, and what they cost is counted where it arises."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

import pytest

from dextera_build.calls import Response, asking, limits
from dextera_build.calls.recorder import Recorder
from dextera_build.calls.spending import Spending, open_ledger
from dextera_build.calls.terms import Terms, written
from dextera_build.errors import MachineError, RuleError
from tests.calls.jobs_service import Client

PRICED = {"forge": {"usd_per_call": 0.5}, "chat": {"usd_per_million_input_tokens": 100.0, "most_usd_per_call": 0.4}}


@pytest.fixture
def ledger():
    descriptor, path = open_ledger()
    yield path
    os.close(descriptor)


@pytest.fixture
def recorder(store, ledger, told):
    def make(most=10.0, services=PRICED):
        terms = Terms.read(written(services, most, ledger, []))
        return Recorder(store, "record", emit=lambda kind, data: told.append((kind, dict(data))), terms=terms)

    return make


def paid(told):
    return [(data["service"], data["usd"], data["sure"]) for kind, data in told if kind == "paid"]


def total(ledger):
    return Spending(Path(ledger), 0.0).total()


def test_no_terms_allow_everything():
    assert Terms.read("").spending is None
    assert Terms.read(written({}, None, "", [])).services == {}


def test_tokens_are_paid_as_counted(recorder, told, ledger):
    body = json.dumps({"usage": {"input_tokens": 3000, "output_tokens": 7}}).encode()
    make = recorder()
    make("chat", {"q": 1}, lambda seconds: body)
    assert paid(told) == [("chat", pytest.approx(0.3), True)]
    assert total(ledger) == pytest.approx(0.3)
    assert make.made[0]["cost"] == pytest.approx(0.3)
    assert "asked, 0.3000 USD" in told[-1][1]["text"]
    make("chat", {"q": 1}, lambda seconds: body)
    assert total(ledger) == pytest.approx(0.3)  # a replay is free
    assert "replayed, " in told[-1][1]["text"]


def test_refusals_are_free_and_lost_answers_count(recorder, told, ledger):
    answers = [Response(b"", 500), ConnectionRefusedError(), TimeoutError("read"), b"{}"]

    def send(seconds):
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    make = recorder()
    make("forge", {}, send, wait_s=0.0)
    assert paid(told) == [("forge", 0.5, False), ("forge", 0.5, True)]
    assert total(ledger) == pytest.approx(1.0)
    assert make.made[0]["cost"] == pytest.approx(1.0)


def test_unusable_answers_cost_too_and_the_limit_holds_over_tries(recorder, told, ledger):
    sent = []

    def send(seconds):
        sent.append(1)
        return b"<html>"

    with pytest.raises(RuleError, match="could exceed the limit of 1\\.20 USD") as caught:
        recorder(most=1.2)("forge", {}, send, valid=json.loads, wait_s=0.0)
    assert caught.value.code == "DXB-B361"
    assert len(sent) == 2
    assert total(ledger) == pytest.approx(1.0)


def test_a_call_over_the_limit_is_not_sent(recorder):
    with pytest.raises(RuleError, match="could exceed the limit of 0\\.3000 USD, so it was not sent"):
        recorder(most=0.3)("chat", {}, lambda seconds: pytest.fail("it was sent"))


def test_a_call_without_a_price_is_not_sent_under_a_limit(recorder, store):
    with pytest.raises(RuleError, match="no price bounds a call of `other`"):
        recorder()("other", {}, lambda seconds: pytest.fail("it was sent"))
    assert Recorder(store, "record")("other", {}, lambda seconds: b"yes") == b"yes"


def test_an_answer_dearer_than_its_price_is_told(recorder, told):
    recorder()("chat", {}, lambda seconds: b'{"usage": {"cost": 2}}')
    assert ("log", {"text": "chat cost 2.00 USD, more than its price of 0.4000 USD"}) in told


def test_a_job_is_paid_once_when_it_is_submitted(recorder, told, ledger, service):
    service.faults = {"POST": ["500"], "GET": ["503"] * 4}
    with pytest.raises(MachineError):
        recorder()("forge", {"of": 1}, Client(service.url), poll_s=0.01, wait_s=0.01)
    assert paid(told) == [("forge", 0.5, True)]
    make = recorder()
    make("forge", {"of": 1}, Client(service.url), poll_s=0.01)
    assert total(ledger) == pytest.approx(0.5)
    assert make.made[0]["cost"] == pytest.approx(0.5)  # of the answer, although this build paid nothing


def test_a_job_over_the_limit_is_not_submitted(recorder, service):
    with pytest.raises(RuleError, match="could exceed"):
        recorder(most=0.4)("forge", {}, Client(service.url))
    assert service.seen == []


def test_a_service_that_is_told_to_rest_is_left_alone_by_all(store, monkeypatch):
    now, rests = [1e9], []

    def sleep(seconds):
        rests.append(seconds)
        now[0] += seconds

    monkeypatch.setattr(limits.time, "time", lambda: now[0])
    monkeypatch.setattr(asking.time, "sleep", sleep)
    with pytest.raises(MachineError):
        Recorder(store, "record")("s", {}, lambda seconds: Response(b"", 429, {"Retry-After": "7"}), tries=1)
    assert rests == []
    Recorder(store, "record")("s", {}, lambda seconds: b"yes")  # another process
    assert rests == [pytest.approx(7.0)]


def test_requests_of_one_service_hold_its_rate(store, monkeypatch):
    now = [1e9]
    monkeypatch.setattr(limits.time, "time", lambda: now[0])
    monkeypatch.setattr(limits.time, "sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    terms = Terms.read(written({"s": {"requests_per_minute": 2}}, None, "", []))
    sent = []
    for number in range(4):
        Recorder(store, "record", terms=terms)("s", {"q": number}, lambda seconds: sent.append(now[0]) or b"yes")
    assert [at - 1e9 for at in sent] == [0.0, 0.0, 60.0, 60.0]


def test_waiting_for_a_turn_takes_nothing_from_the_timeout(store, monkeypatch):
    terms = Terms.read(written({"s": {"concurrent": 1}}, None, "", []))
    began, seen = time.monotonic(), []
    Recorder(store, "record", terms=terms)("s", {}, lambda seconds: seen.append(seconds) or b"yes", timeout_s=3.0)
    assert seen == [3.0]
    assert time.monotonic() - began < 3.0


@pytest.fixture
def dripping():
    """The address of a server that sends a byte each 20 ms, of an answer that is never complete."""
    server, stop = socket.create_server(("127.0.0.1", 0)), threading.Event()

    def serve(client):
        with client, suppress(OSError):
            client.recv(4096)
            client.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")
            while not stop.wait(0.02):
                client.sendall(b"x")

    def accept():
        with suppress(OSError):
            while True:
                threading.Thread(target=serve, args=server.accept()[:1], daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    yield f"http://127.0.0.1:{server.getsockname()[1]}"
    stop.set()
    server.close()


@pytest.mark.slow
def test_an_answer_that_drips_is_given_up(store, dripping):
    def send(seconds):
        with urllib.request.urlopen(dripping, timeout=seconds) as answer:
            return answer.read()  # each byte comes within the timeout

    began = time.monotonic()
    with pytest.raises(MachineError, match="TimeoutError: the answer is not complete after 2 s"):
        Recorder(store, "record")("s", {}, send, timeout_s=0.2, tries=2, wait_s=0.01)
    assert 4.0 <= time.monotonic() - began < 15.0
