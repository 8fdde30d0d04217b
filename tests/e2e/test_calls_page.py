"""The rules, recipe and settings on the page about calls work as they stand there, against local services."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

import dextera_build
from tests.calls.jobs_service import JobService, serving_jobs
from tests.calls.services import Service, serving
from tests.e2e.space import Space

PAGE = (Path(dextera_build.__file__).parent / "docs" / "calls.md").read_text()
GOOD = json.dumps({"name": "mug", "colour": "blue"})


def block(kind: str, word: str) -> str:
    """The one block of a kind that holds a word."""
    (found,) = [text for text in re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE) if word in text]
    return found


@pytest.fixture
def seer() -> Iterator[Service]:
    with serving() as made:
        made.content = GOOD
        yield made


@pytest.fixture
def forge() -> Iterator[JobService]:
    with serving_jobs() as made:
        yield made


@pytest.fixture
def page(space: Space, seer: Service, forge: JobService, monkeypatch: pytest.MonkeyPatch) -> Space:
    for name, value in {
        "SEER_URL": seer.url,
        "SEER_API_KEY": "geheim-0123456789",
        "FORGE_URL": forge.url,
        "FORGE_API_KEY": "geheim-9876543210",
    }.items():
        monkeypatch.setenv(name, value)
    space.write("rules/look/describe.py", block("python", '"""look.describe'))
    space.write("rules/look/forge.py", block("python", '"""look.forge').replace("poll_s=5.0", "poll_s=0.05"))
    space.write("recipes/look/thing.yaml", block("yaml", "look.forge"))
    space.write("dxb.toml", block("toml", "[services.seer]"))
    (space.root / "thing.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"0" * 100)
    return space


@pytest.mark.slow
def test_the_examples_of_the_page_run(page: Space, seer: Service, forge: JobService) -> None:
    seer.contents = ["a mug, I think"]
    forge.faults = {"POST": ["429"], "GET": ["cut"], "FETCH": ["500"]}
    for line in block("console", "dxb build look/thing").splitlines():
        answer = page.dxb(*shlex.split(line)[2:])
        assert answer.code == 0, answer.err
    assert (page.root / "cache/out/look/thing/seen/seen").read_text() == GOOD
    assert b"made by job-1" in (page.root / "cache/out/look/thing/made/made").read_bytes()
    assert "cost: 0.2540 USD for 3 requests" in answer.err
    _, second = seer.asked
    assert [message["role"] for message in second["messages"]] == ["user", "assistant", "user"]
    assert "This cannot be used" in second["messages"][2]["content"]
    assert len(forge.jobs) == 1
    hidden = [path for path in page.root.rglob("*") if path.is_file() and b"geheim-" in path.read_bytes()]
    assert hidden == []
    offline = page.dxb("build", "look/thing", "--force", "seen", "--force", "made", "--calls", "replay")
    assert offline.code == 0, offline.err


def test_without_consent_the_examples_send_nothing(page: Space, seer: Service, forge: JobService) -> None:
    answer = page.dxb("build", "-k", "look/thing")
    assert answer.code == 1
    assert answer.err.count("DXB-E365") == 2
    assert (seer.asked, forge.seen) == ([], [])
