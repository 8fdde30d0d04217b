"""Servers to talk to: methods that a test writes, and a client of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import contextmanager
from typing import Any

import grpc

from dextera_build.store import wire
from dextera_build.store.remotes import protocol as api
from dextera_build.store.remotes.reapi import Reapi
from tests.store.remotes.things import digest_of

KEY = digest_of(b"a key document")
ALL_GOOD = api.ServerCapabilities(api.CacheCapabilities((1,), api.UpdateCapabilities(True), 0))


@contextmanager
def connected(port: int, instance: str = "", timeout_s: float = 10) -> Iterator[Reapi]:
    remote = Reapi(f"127.0.0.1:{port}", instance, tls=False, timeout_s=timeout_s)
    try:
        yield remote
    finally:
        remote.close()


@contextmanager
def scripted(script: dict[str, Callable[..., Any]]) -> Iterator[int]:
    """A server whose methods are functions from bytes to bytes; those that are not named know nothing."""
    methods = {"GetCapabilities": lambda request, context: wire.encode(ALL_GOOD), **script}
    services: dict[str, tuple[str, Any]] = {
        "GetCapabilities": (api.CAPABILITIES, grpc.unary_unary_rpc_method_handler),
        "GetActionResult": (api.ACTION_CACHE, grpc.unary_unary_rpc_method_handler),
        "UpdateActionResult": (api.ACTION_CACHE, grpc.unary_unary_rpc_method_handler),
        "FindMissingBlobs": (api.CAS, grpc.unary_unary_rpc_method_handler),
        "BatchReadBlobs": (api.CAS, grpc.unary_unary_rpc_method_handler),
        "BatchUpdateBlobs": (api.CAS, grpc.unary_unary_rpc_method_handler),
        "Read": (api.BYTE_STREAM, grpc.unary_stream_rpc_method_handler),
        "Write": (api.BYTE_STREAM, grpc.stream_unary_rpc_method_handler),
        "QueryWriteStatus": (api.BYTE_STREAM, grpc.unary_unary_rpc_method_handler),
    }
    running = grpc.server(futures.ThreadPoolExecutor(8))
    for name, work in methods.items():
        service, handler = services[name]
        running.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(service, {name: handler(work)})])
    port = running.add_insecure_port("127.0.0.1:0")
    running.start()
    try:
        yield port
    finally:
        running.stop(0).wait()
