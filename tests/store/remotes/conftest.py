"""A store that is served over gRPC."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dextera_build.store.remotes.grpc_server import GrpcServer, serve_grpc
from dextera_build.store.remotes.reapi import Reapi
from dextera_build.store.store import Store
from tests.store.remotes.grpc_servers import connected


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def server(store: Store) -> Iterator[GrpcServer]:
    running = serve_grpc(store, "127.0.0.1", 0, read_only=False)
    yield running
    running.stop(0)


@pytest.fixture
def remote(server: GrpcServer) -> Iterator[Reapi]:
    with connected(server.port) as found:
        yield found
