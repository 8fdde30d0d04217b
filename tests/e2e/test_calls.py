"""Calls of a service through the real `dxb`: asked once, recorded, replayed elsewhere without the service."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.calls.services import KEY, Service, serving
from tests.e2e.space import Answer, Space

RULE = '''
"""toy.describe: asks a service what a text is."""
import json
import os
import urllib.error
import urllib.request
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, Response, rule

class DescribeOptions(Options):
    """Options."""
    question: str = "what is this?"
    """What to ask."""

@rule(version=1)
def describe(ctx: Context, text: File, *, options: DescribeOptions) -> File:
    """Return what the service says."""
    request = {"model": "tiny-1", "question": options.question, "file": text.data}

    def send(timeout_s: float) -> Response:
        asked = urllib.request.Request(os.environ["TOY_URL"] + "/chat/completions", method="POST")
        asked.add_header("Authorization", "Bearer " + os.environ["TOY_API_KEY"])
        data = json.dumps({"question": options.question, "text": text.data.decode()}).encode()
        try:
            patience_s = float(os.environ.get("TOY_PATIENCE", timeout_s))
            with urllib.request.urlopen(asked, data, timeout=patience_s) as answer:
                return Response(answer.read(), answer.status)
        except urllib.error.HTTPError as error:
            return Response(error.read(), error.code, dict(error.headers))

    def valid(body: bytes) -> None:
        said = json.loads(body)["choices"][0]["message"]["content"]
        if os.environ.get("TOY_KILL"):
            os.kill(os.getpid(), 9)

    body = ctx.call("toy-chat", request, send, valid=valid, wait_s=0.05)
    said = json.loads(body)["choices"][0]["message"]["content"]
    ctx.say(said)
    return File(data=said.encode())
'''
RECIPE = """
summary: What a service says.
nodes:
  start: {rule: toy.start, text: one}
  seen: {rule: toy.describe, text: $start}
targets:
  default: [seen]
"""


@pytest.fixture
def service() -> Iterator[Service]:
    with serving() as made:
        yield made


@pytest.fixture
def asking(space: Space) -> Space:
    space.write("rules/toy/describe.py", RULE.lstrip())
    space.write("recipes/say/seen.yaml", RECIPE.lstrip())
    return space


def build(space: Space, service: Service | None, *words: str, **env: str) -> Answer:
    """Build on a machine that knows the service, or on one that does not."""
    known = {"TOY_URL": service.url, "TOY_API_KEY": KEY} if service else {}
    return space.dxb("build", "--console", "jsonl", "say/seen", *words, env={**known, **env})


def result(space: Space, store: str = "cache") -> bytes:
    return (space.root / store / "out/say/seen/seen/seen").read_bytes()


def calls(answer: Answer) -> list[dict]:
    return [c for e in answer.events if e["event"] == "node_finished" and e["node"] == "seen" for c in e["calls"]]


def test_asked_once_and_replayed_without_the_service(asking: Space, service: Service) -> None:
    first = build(asking, service)
    assert first.code == 0, first.err
    (made,) = calls(first)
    assert (made["service"], made["model"], made["how"]) == ("toy-chat", "tiny-1", "asked")
    assert (made["total_tokens"], made["cost"]) == (1000, 0.002)
    # Another key of the node, the same request.
    asking.edit("rules/toy/describe.py", "return File(data=said.encode())", "return File(data=said.upper().encode())")
    again = build(asking, None, "--calls", "replay")
    assert again.code == 0, again.err
    assert [call["how"] for call in calls(again)] == ["replayed"]
    assert result(asking) == b"A RED MUG"
    assert len(service.asked) == 1
    assert service.asked[0]["key"] == f"Bearer {KEY}"


def test_a_miss_offline_is_one_clear_error(asking: Space) -> None:
    answer = asking.dxb("build", "--console", "none", "say/seen", "--calls", "replay")
    assert answer.code == 1
    failed = build(asking, None, "--calls", "replay").events
    (error,) = [event["error"] for event in failed if event["event"] == "node_finished" and event["error"]]
    assert error["code"] == "DXB-B340"
    assert error["message"] == ("no answer of `toy-chat tiny-1` to this request is recorded, and nothing may be asked")
    assert error["facts"]["request"].endswith(" bytes")
    assert "--calls record" in error["hint"]


def test_a_remote_brings_answers_to_a_node_with_another_key(asking: Space, service: Service) -> None:
    assert build(asking, service, DXB_CACHE="one", DXB_REMOTES="./share:rw").code == 0
    asking.edit("rules/toy/describe.py", "return File(data=said.encode())", "return File(data=said.upper().encode())")
    second = build(asking, None, "--calls", "replay", "--cache", "local:rw,./share:r", DXB_CACHE="two")
    assert second.code == 0, second.err
    assert [call["how"] for call in calls(second)] == ["fetched"]
    assert result(asking, "two") == b"A RED MUG"


@pytest.mark.medium
def test_a_bundle_brings_answers(asking: Space, service: Service) -> None:
    assert build(asking, service, DXB_CACHE="one").code == 0
    made = asking.dxb("bundle", "create", "say/seen", "--out", "seen.tar", env={"DXB_CACHE": "one"})
    assert made.code == 0, made.err
    taken = asking.dxb("bundle", "import", "seen.tar", env={"DXB_CACHE": "two"})
    assert taken.code == 0, taken.err
    asking.edit("rules/toy/describe.py", "return File(data=said.encode())", "return File(data=said.upper().encode())")
    second = build(asking, None, "--calls", "replay", DXB_CACHE="two")
    assert second.code == 0, second.err
    assert [call["how"] for call in calls(second)] == ["replayed"]
    checked = asking.dxb("cache", "verify", env={"DXB_CACHE": "two"})
    assert checked.code == 0, checked.out + checked.err


def test_no_secret_lies_in_the_store(asking: Space, service: Service) -> None:
    service.faults = ["500", "echo"]
    refused = build(asking, service)
    assert refused.code == 1
    assert "DXB-B346" in refused.err
    service.faults = ["403"]
    assert build(asking, service).code == 1
    assert build(asking, service).code == 0
    hidden = [KEY.encode(), service.url.encode(), service.url.partition("//")[2].partition("/")[0].encode()]
    files = [path for path in (asking.root / "cache").rglob("*") if path.is_file()]
    assert len(files) > 10
    assert [path for path in files for word in hidden if word in path.read_bytes()] == []


@pytest.mark.medium
@pytest.mark.parametrize(
    ("faults", "code", "asked"),
    [
        (["500", "torn"], None, 3),
        (["slow"], None, 2),
        (["429"], None, 2),
        (["nonsense"], None, 2),
        (["400"], "DXB-B344", 1),
        (["401"], "DXB-E361", 1),
        (["503"] * 4, "DXB-E360", 4),
        (["nonsense"] * 4, "DXB-B345", 4),
    ],
)
def test_faults_of_a_service(asking: Space, service: Service, faults: list[str], code: str | None, asked: int) -> None:
    service.faults = list(faults)
    answer = build(asking, service, **({"TOY_PATIENCE": "0.5"} if faults == ["slow"] else {}))
    assert (answer.code == 0) == (code is None), answer.err
    assert len(service.asked) == asked, answer.err
    if code is not None:
        assert code in answer.err
        assert "Traceback" not in answer.err
        # Nothing was recorded, and the next build asks again.
        assert build(asking, service).code == 0
        assert len(service.asked) == asked + 1


@pytest.mark.medium
def test_refresh_compares_and_replace_replaces(asking: Space, service: Service) -> None:
    build(asking, service)
    assert [call["how"] for call in calls(build(asking, service, "--calls", "refresh"))] == ["confirmed"]
    service.content = "a blue mug"
    other = build(asking, service, "--calls", "refresh")
    assert [call["how"] for call in calls(other)] == ["diverged"]
    assert result(asking) == b"a red mug"
    assert asking.dxb("ls", "divergent").out.startswith("call toy-chat tiny-1\t")
    new = build(asking, service, "--calls", "replace")
    assert [call["how"] for call in calls(new)] == ["replaced"]
    assert result(asking) == b"a blue mug"
    assert len(service.asked) == 4
    assert result(asking) == b"a blue mug"
    assert build(asking, None, "--force", "seen", "--calls", "replay").code == 0
    assert result(asking) == b"a blue mug"


def test_profile_stub_never_calls(asking: Space, service: Service) -> None:
    answer = build(asking, service, "--profile", "stub")
    assert "DXB-B341" in answer.err
    assert service.asked == []


def test_a_mode_that_there_is_not(asking: Space) -> None:
    answer = asking.dxb("build", "say/seen", "--calls", "maybe")
    assert answer.code == 2
    assert "error[DXB-U103]: `calls` cannot be `maybe`" in answer.err


def test_a_kill_before_the_record_costs_one_more_call(asking: Space, service: Service) -> None:
    assert build(asking, service, TOY_KILL="1").code == 1
    assert asking.dxb("cache", "verify").code == 0
    assert build(asking, service).code == 0
    assert len(service.asked) == 2
    assert result(asking) == b"a red mug"


@pytest.mark.medium
def test_two_builds_with_one_request_ask_once(asking: Space, service: Service) -> None:
    service.faults = ["500", "500"]
    text = (asking.root / "rules/toy/describe.py").read_text()
    asking.write("rules/toy/retell.py", text.replace("describe", "retell").replace("Describe", "Retell"))
    asking.write("recipes/say/told.yaml", RECIPE.replace("describe", "retell"))
    env = asking.environment(TOY_URL=service.url, TOY_API_KEY=KEY)
    builds = [
        subprocess.Popen(
            [sys.executable, "-m", "dextera_build", "build", "--console", "none", name], cwd=asking.root, env=env
        )
        for name in ("say/seen", "say/told")
    ]
    assert [build.wait(120) for build in builds] == [0, 0]
    assert len(service.asked) == 3


def test_a_lost_answer_is_asked_again_or_said(asking: Space, service: Service) -> None:
    build(asking, service)
    body = service.answer()
    (kept,) = [path for path in (asking.root / "cache/cas").rglob("*") if path.is_file() and path.read_bytes() == body]
    os.unlink(kept)
    offline = build(asking, None, "--calls", "replay")
    assert offline.code == 1
    assert "DXB-B340" in offline.err
    assert build(asking, service).code == 0
    assert len(service.asked) == 2


def test_a_collection_keeps_the_calls_of_what_is_built(asking: Space, service: Service) -> None:
    build(asking, service)
    for path in (asking.root / "cache").rglob("*"):
        if path.is_file() and path.relative_to(asking.root / "cache").parts[0] in ("ac", "cas"):
            os.utime(path, (1e9, 1e9))
    assert asking.dxb("cache", "gc", "--max-age", "1d", "--yes").code == 0
    answer = build(asking, None, "--force", "seen", "--calls", "replay")
    assert answer.code == 0, answer.err


def test_ls_and_show_name_calls(asking: Space, service: Service) -> None:
    (made,) = calls(build(asking, service))
    row = asking.dxb("ls", "calls").out.rstrip("\n").split("\t")
    assert row[:3] == [made["call"][:12], "toy-chat", "tiny-1"]
    assert "1000" in row
    (listed,) = asking.dxb("ls", "calls", "--json").rows
    assert listed["call"] == made["call"]
    assert (listed["model"], listed["tokens"]) == ("tiny-1", 1000)
    whole = asking.dxb("show", made["call"][:12], "--json").document
    assert whole["request"]["question"] == "what is this?"
    shown = asking.dxb("show", made["call"][:12]).out
    assert 'request.question\t"what is this?"' in shown
    assert "a red mug" in shown
    lineage = asking.dxb("show", "say/seen:seen", "--lineage").out
    assert f"call {made['call'][:12]}\ttoy-chat tiny-1" in lineage
    unknown = asking.dxb("show", "0123456789ab")
    assert unknown.code == 2
