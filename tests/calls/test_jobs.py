"""Jobs of services: one per request whatever happens in between, and nothing but good answers is recorded."""

from __future__ import annotations

import json
import signal
import threading

import pytest

from dextera_build.calls import Job, asking
from dextera_build.calls.recorder import Recorder
from dextera_build.errors import DxbError, MachineError, RuleError
from tests.calls.jobs_service import Client

QUICK = {"poll_s": 0.01, "wait_s": 0.01}


@pytest.fixture
def ask(store, service, told):
    def run(mode="record", client=None, **manner):
        recorder = Recorder(store, mode, emit=lambda kind, data: told.append((kind, dict(data))))
        return recorder("forge", {"of": "a mug"}, client or Client(service.url), **QUICK | manner)

    return run


def kept(store):
    return [key for key, _, _ in store.keep.all()]


def test_a_client_is_a_job(service):
    assert isinstance(Client(service.url), Job)
    assert not isinstance(lambda seconds: b"", Job)


def test_a_job_is_submitted_polled_fetched_and_then_replayed(store, service, ask, told):
    assert json.loads(ask()) == {"text": "made by job-1"}
    assert service.seen == ["POST", "GET", "GET", "GET", "FETCH"]
    assert json.loads(ask("replay")) == {"text": "made by job-1"}
    assert len(service.seen) == 5
    assert kept(store) == []
    lines = [data["text"] for kind, data in told if kind == "log"]
    assert lines[0] == "forge: submitted the job job-1"
    assert "forge, replayed" in lines[-1]
    assert ("progress", {"done": 0, "total": 100, "what": "forge job runs"}) in told
    assert [data["seconds"] for kind, data in told if kind == "grace"] == [10.0, 1.0]


@pytest.mark.medium
@pytest.mark.parametrize(
    "faults",
    [
        {"POST": ["500", "429"], "GET": ["503", "cut"], "FETCH": ["torn", "500"]},
        {"GET": ["slow"], "FETCH": ["slow"]},
    ],
)
def test_every_request_of_a_job_is_retried(service, ask, faults):
    service.faults = {kind: list(those) for kind, those in faults.items()}
    client = Client(service.url, patience_s=0.5)
    assert json.loads(ask(client=client, valid=json.loads)) == {"text": "made by job-1"}
    assert len(service.jobs) == 1


def test_an_outage_keeps_the_job_for_the_next_build(store, service, ask):
    service.faults = {"GET": ["503"] * 4}
    with pytest.raises(MachineError, match="cannot be reached: it answered 503") as caught:
        ask()
    assert caught.value.code == "DXB-E360"
    assert len(kept(store)) == 1
    assert json.loads(ask()) == {"text": "made by job-1"}
    assert service.seen.count("POST") == 1
    assert kept(store) == []


def test_a_job_that_takes_too_long_goes_on(service, ask, told):
    service.polls = 1000
    with pytest.raises(MachineError, match="the job of `forge` is not done after 0 s") as caught:
        ask(limit_s=0.05)
    assert caught.value.code == "DXB-E364"
    assert caught.value.facts["job"] == "job-1"
    assert "waits for the same job" in caught.value.hint
    service.jobs["job-1"] = 1
    assert json.loads(ask()) == {"text": "made by job-1"}
    assert ("log", {"text": "forge: waits for the job job-1 of an earlier build"}) in told


def test_a_job_that_fails_is_submitted_anew_by_the_next_build(store, service, ask):
    service.fails = "no mug\nin sight"
    with pytest.raises(RuleError, match="the job of `forge` failed: no mug in sight") as caught:
        ask()
    assert caught.value.code == "DXB-B360"
    service.fails = ""
    assert json.loads(ask()) == {"text": "made by job-2"}


def test_a_job_that_the_service_forgot_is_submitted_anew(service, ask, told):
    service.faults = {"GET": ["503"] * 4}
    with pytest.raises(MachineError):
        ask()
    service.jobs = {"job-0": 0}
    assert json.loads(ask()) == {"text": "made by job-2"}
    assert ("log", {"text": "forge: does not know the job job-1 any more"}) in told


def test_a_new_job_that_the_service_does_not_know_is_an_error(service, ask):
    service.faults = {"GET": ["404"]}
    with pytest.raises(RuleError, match="failed: the service does not know it"):
        ask()


def test_an_unusable_answer_is_not_recorded_and_not_fetched_for_ever(service, ask):
    service.faults = {"FETCH": ["nonsense"] * 4}
    with pytest.raises(RuleError) as caught:
        ask(valid=json.loads)
    assert caught.value.code == "DXB-B345"
    assert json.loads(ask(valid=json.loads)) == {"text": "made by job-2"}


def test_a_refused_job_names_what_the_service_said(service, ask):
    service.faults = {"POST": ["400"]}
    with pytest.raises(RuleError, match="refuses the request: it answered 400"):
        ask()
    assert service.seen == ["POST"]


def test_damaged_progress_costs_a_new_job(store, service, ask):
    service.faults = {"GET": ["503"] * 4}
    with pytest.raises(DxbError):
        ask()
    (file,) = store.keep.root.rglob("job.json")
    file.chmod(0o644)
    file.write_text("[")
    assert json.loads(ask()) == {"text": "made by job-2"}


@pytest.mark.parametrize("while_submitting", [False, True])
def test_ctrl_c_cancels_the_job(store, service, ask, told, while_submitting):
    service.polls = 10**6
    if while_submitting:
        service.holds.clear()

    def interrupt():
        while not service.jobs or ("GET" not in service.seen and not while_submitting):
            pass
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        threading.Event().wait(0.3)
        service.holds.set()

    thread = threading.Thread(target=interrupt)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            ask()
    finally:
        thread.join()
        signal.signal(signal.SIGINT, before)
    assert service.cancelled == ["job-1"]
    assert list(store.keep.root.rglob("job.json")) == []
    assert ("log", {"text": "forge: cancelled the job job-1"}) in told


class Stopped(Client):
    """Ctrl-C at the first poll."""

    def poll(self, name, timeout_s):
        raise KeyboardInterrupt


@pytest.mark.parametrize("how", ["refused", "cut"])
def test_a_job_that_cannot_be_cancelled_is_kept(store, service, ask, told, how):
    service.faults = {"DELETE": ["409" if how == "refused" else "cut"]}
    with pytest.raises(KeyboardInterrupt):
        ask(client=Stopped(service.url))
    lines = " ".join(data["text"] for kind, data in told if kind == "log")
    assert ("cannot cancel the job job-1" if how == "refused" else "job-1 could not be cancelled") in lines
    assert json.loads(ask()) == {"text": "made by job-1"}


def test_two_threads_with_one_request_submit_one_job(service, ask):
    got = []
    threads = [threading.Thread(target=lambda: got.append(ask())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(got)) == 1
    assert len(got) == 4
    assert service.seen.count("POST") == 1


def test_a_wrong_client_is_a_clear_error(service, ask):
    class Wrong(Client):
        def poll(self, name, timeout_s):
            return asking.Response(b"", 200)

    with pytest.raises(TypeError, match="returned a response in place of its value"):
        ask(client=Wrong(service.url))
