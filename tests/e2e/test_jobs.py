"""Jobs of a service through the real `dxb`: a killed build goes on with the same job, Ctrl-C cancels it."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator

import pytest

from tests.calls.jobs_service import JobService, serving_jobs
from tests.e2e.space import Space

RULE = '''
"""toy.forge: has something made by a service."""
import json
import os
import urllib.error
import urllib.request
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, JobState, Response, rule

class Forge:
    """Client of the service."""

    def submit(self, timeout_s: float) -> str:
        return json.loads(self.send("POST", "", timeout_s))["id"]

    def poll(self, name: str, timeout_s: float) -> JobState:
        return JobState(json.loads(self.send("GET", f"/{name}", timeout_s))["state"])

    def fetch(self, name: str, timeout_s: float) -> bytes:
        return self.send("GET", f"/{name}/answer", timeout_s)

    def cancel(self, name: str, timeout_s: float) -> bool:
        return bool(self.send("DELETE", f"/{name}", timeout_s))

    def send(self, method: str, path: str, timeout_s: float) -> bytes:
        asked = urllib.request.Request(os.environ["FORGE_URL"] + "/jobs" + path, method=method)
        with urllib.request.urlopen(asked, timeout=timeout_s) as answer:
            return answer.read()

@rule(version=1)
def forge(ctx: Context, text: File) -> File:
    """Return what the service made."""
    body = ctx.job("forge", {"of": text.data}, Forge(), poll_s=0.05, valid=json.loads)
    return File(data=json.loads(body)["text"].encode())
'''
RECIPE = """
nodes:
  start: {rule: toy.start, text: one}
  made: {rule: toy.forge, text: $start}
targets: {default: [made]}
"""


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Iterator[JobService]:
    with serving_jobs() as made:
        monkeypatch.setenv("FORGE_URL", made.url)
        yield made


@pytest.fixture
def forging(space: Space, service: JobService) -> Space:
    space.write("rules/toy/forge.py", RULE.lstrip())
    space.write("recipes/say/forge.yaml", RECIPE.lstrip())
    return space


def end_while_polling(space: Space, service: JobService, how: signal.Signals) -> None:
    service.polls = 10**6
    process = space.start("build", "say/forge", start_new_session=True)
    deadline = time.monotonic() + 60
    while service.seen.count("GET") < 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(how)
    process.communicate(timeout=40)
    assert process.returncode == (130 if how == signal.SIGINT else -how)


def result(space: Space) -> bytes:
    return (space.root / "cache/out/say/forge/made/made").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("edited", [False, True])
def test_a_build_after_a_kill_waits_for_the_same_job(forging: Space, service: JobService, edited: bool) -> None:
    end_while_polling(forging, service, signal.SIGKILL)
    if edited:  # another key of the node, the same request
        forging.edit("rules/toy/forge.py", '["text"].encode()', '["text"].upper().encode()')
    service.jobs["job-1"] = 1
    answer = forging.build("say/forge")
    assert answer.code == 0, answer.err
    assert result(forging) == (b"MADE BY JOB-1" if edited else b"made by job-1")
    assert service.seen.count("POST") == 1
    assert service.cancelled == []
    keep = forging.root / "cache/local/keep"
    assert [path for path in keep.rglob("*") if path.is_file()] == []


@pytest.mark.medium
def test_ctrl_c_cancels_the_job(forging: Space, service: JobService) -> None:
    end_while_polling(forging, service, signal.SIGINT)
    assert service.cancelled == ["job-1"]
    service.polls = 1
    answer = forging.build("say/forge")
    assert answer.code == 0, answer.err
    assert result(forging) == b"made by job-2"


def test_an_answer_is_replayed_without_the_service(forging: Space, service: JobService) -> None:
    assert forging.build("say/forge").code == 0
    seen = len(service.seen)
    again = forging.build("say/forge", "--force", "made", "--calls", "replay")
    assert again.code == 0, again.err
    assert len(service.seen) == seen


@pytest.mark.slow
def test_a_slow_service_has_the_time_to_cancel(forging: Space, service: JobService) -> None:
    service.faults = {"DELETE": ["slow"]}  # longer than a worker without a job gets
    end_while_polling(forging, service, signal.SIGINT)
    assert service.cancelled == ["job-1"]
