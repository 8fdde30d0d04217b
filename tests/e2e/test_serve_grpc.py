"""`dxb cache serve --grpc` through the real `dxb`."""

from __future__ import annotations

import signal
import socket
from collections.abc import Iterator

import pytest

from tests.e2e.machines import EVERY, agree, machine, uploads
from tests.e2e.space import Space


@pytest.fixture
def served_grpc(space: Space) -> Iterator[tuple[str, str]]:
    """`dxb cache serve --grpc` as a process: its two addresses."""
    server = space.start("cache", "serve", "--port", "0", "--grpc", "0", "--cache", "served")
    assert server.stdout is not None
    yield server.stdout.readline().strip(), server.stdout.readline().strip()
    server.send_signal(signal.SIGINT)
    _, said = server.communicate(timeout=60)
    assert server.returncode == 0, said


def test_machines_share_over_grpc_and_over_http(space: Space, served_grpc: tuple[str, str]) -> None:
    """A result that came one way is found the other way: the store knows it by its key."""
    http, grpc = served_grpc
    assert grpc.startswith("grpc://127.0.0.1:")
    first = machine(space, "one", "say/words", use=f"{grpc}:rw")
    assert first.nodes("ran") == EVERY, first.err
    assert uploads(first) == [(7, 0)]
    for name, remote in (("two", f"{grpc}/any/instance"), ("three", http)):
        answer = machine(space, name, "say/words", use=f"{remote}:r")
        assert answer.nodes("fetched") == EVERY, answer.err
        assert agree(space, name, "one")
    space.edit("recipes/say/words.yaml", "one", "uno")
    assert machine(space, "four", "say/words", use=f"{http}:rw").code == 0
    answer = machine(space, "five", "say/words", use=f"{grpc}:r")
    assert answer.code == 0
    assert answer.nodes("ran") == set()


def test_a_port_that_is_taken_is_said(space: Space) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        answer = space.dxb("cache", "serve", "--port", "0", "--grpc", str(taken.getsockname()[1]))
    assert answer.code == 1
    assert "DXB-S223" in answer.err
    assert "nothing can listen on" in answer.err
    assert "Traceback" not in answer.err
