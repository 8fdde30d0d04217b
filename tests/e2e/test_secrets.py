"""No password or token that a command was given is written anywhere: store, caches, logs, reports, what it prints."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from dextera_build.remotes.server import CacheServer
from dextera_build.store.store import Store
from tests.e2e.space import Answer, Space
from tests.remotes.servers import deaf_port

SECRET = "geheim"
"""Part of every secret below."""
VARIABLES = {
    "DXB_KEY_PASSPHRASE": f"{SECRET}-1",
    "DXB_SERVE_SECRET": f"{SECRET}-2",
    "DXB_VLM_API_KEY": f"{SECRET}-3",
    "CACHE_PASSWORD": f"{SECRET}-server",
}


@pytest.fixture
def host(space: Space) -> Iterator[str]:
    """A server that lets in whoever knows the secret."""
    with CacheServer(Store(space.root / "served"), ("127.0.0.1", 0), secret=VARIABLES["CACHE_PASSWORD"]) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server.url.removeprefix("http://")
        server.shutdown()


@pytest.fixture
def closed() -> Iterator[str]:
    """A server that is not there."""
    with deaf_port() as port:
        yield f"127.0.0.1:{port}"


def holders(space: Space, answers: list[Answer]) -> list[str]:
    """What holds a secret: files below the space, and commands that printed one."""
    found = [str(path) for path in space.root.rglob("*") if SECRET.encode() in _bytes(path) or SECRET in path.name]
    return [*found, *(text for answer in answers for text in (answer.out, answer.err) if SECRET in text)]


def _bytes(path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


@pytest.mark.slow
def test_nothing_that_a_build_left_holds_a_secret(space: Space, host: str, closed: str) -> None:
    works = f"http://dxb:{SECRET}-server@{host}"
    answers: list[Answer] = []

    def dxb(*words: str, codes: tuple[int, ...] = (0,), **more: str) -> Answer:
        answers.append(space.dxb(*words, env=VARIABLES | more))
        assert answers[-1].code in codes, answers[-1].err
        return answers[-1]

    dxb("build", "say/words", "--cache", f"local:rw,{works}:rw", "--console", "jsonl")
    dxb("build", "say/words", "--cache", f"local:rw,{works}:rw")
    dxb("build", "say/words", DXB_REMOTES=f"{works}:r")
    dxb("build", "say/words", DXB_REMOTES=f"{works}:r")
    for number, address in enumerate(
        (
            f"http://anna:{SECRET}@{closed}/x",  # no connection
            f"http://dxb:{SECRET}@{host}",  # the wrong password
            f"http://{host}/x?token={SECRET}",  # no password
            f"http://{closed}/x?sig={SECRET}&more=1",
        )
    ):
        more = ("--set", f"word[one].loud.times={number + 4}")
        gave_up = dxb("build", "say/words", *more, "--cache", f"local:rw,{address}:rw", "--console", "plain")
        assert "***" in gave_up.err
        dxb("cache", "push", "say/words", *more, "--to", address, codes=(0, 1))
        dxb("cache", "pull", "say/words", "--set", "word[one].loud.times=17", "--from", address, codes=(1,))
        dxb("plan", "say/words", "--cache", f"local:rw,{address}:r")
        dxb("show", "--config", "--cache", f"local:rw,{address}:r")
        dxb("doctor", "--cache", f"local:rw,{address}:r", codes=(0, 1, 4))
    dxb("build", "say/words")
    for wrong in (
        f"http://anna:{SECRET}@192.0.2.1/x",
        f"ftp://anna:{SECRET}@h/x",
        f"anna:{SECRET}@h",
        f"https://anna:a,{SECRET}@h/x",
        f"https://anna:a/{SECRET}@h/x",
        f"s3://anna:{SECRET}@bucket/x?sig={SECRET}",
    ):
        dxb("build", "say/words", "--force", "say/words:all", "--cache", f"local:rw,{wrong}:r", codes=(0, 2))
        dxb("cache", "pull", "say/words", "--from", wrong, codes=(0, 1, 2))
    dxb("cache", "push", "say/words", "--to", works)
    dxb("cache", "pull", "say/words", "--from", works, DXB_CACHE="two")
    dxb("bundle", "create", "say/words", "-o", "words.tar")
    dxb("report", "-o", "report.html")
    dxb("log")
    dxb("log", "--json")
    dxb("ls", "runs")
    dxb("why", "say/words:all")
    assert holders(space, answers) == []


@pytest.mark.medium
def test_a_variable_in_an_address_stays_a_variable(space: Space, host: str) -> None:
    space.write("dxb.toml", f'cache = "cache"\n[remotes]\nlab = "http://dxb:${{CACHE_PASSWORD}}@{host}"\n')
    answers = [
        space.dxb("build", "say/words", "--cache", "local:rw,lab:rw", env=VARIABLES),
        space.dxb("show", "--config", env=VARIABLES),
        space.dxb("cache", "push", "say/words", "--to", "lab", env=VARIABLES),
    ]
    assert [answer.code for answer in answers] == [0, 0, 0]
    assert "7 results uploaded" in answers[0].err
    assert holders(space, answers) == []
