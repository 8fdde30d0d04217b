"""A server of rosbridge that others wrote, in a domain of DDS, with the answers of rosapi."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import subprocess
import sysconfig
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dextera_build.deploying.transport import Transport
from tests.readers import ENVIRONMENTS
from tests.remotes.servers import free_port

DISTRIBUTION = "jazzy"


@contextlib.contextmanager
def server(domain: int, folder: Path) -> Iterator[int]:
    """rosbridge-server-rs, a node of ROS 2 by Fast DDS; yields its port. The test is skipped without it.

    It is built for an installation of ROS 2, whose parts the wheels of `.venv/readers/ros` have, but for the library
    that chooses an RMW, and for the types of rosapi.
    """
    ros, own = ENVIRONMENTS / "ros", ENVIRONMENTS / "rosbridge"
    for home in (ros, own):
        if not (home / ".installed").exists():
            pytest.skip(f"needs .venv/readers/{home.name}; `make readers` makes it")
    (built,) = own.glob(f"lib/python3*/site-packages/rosbridge_server_rs/rosbridge_server_rs_{DISTRIBUTION}")
    program, chosen = folder / built.name, folder / "librmw_implementation.so"
    shutil.copy(built, program)
    program.chmod(0o755)
    chosen.symlink_to((ros / "lib" / "librmw_fastrtps_cpp.so").resolve())
    libraries = [ros / "lib", folder, *ros.glob("lib/python3*/site-packages/ros_*.libs")]
    # Types for Python are loaded, too, and expect its symbols.
    python = Path(sysconfig.get_config_var("LIBDIR")) / sysconfig.get_config_var("LDLIBRARY")
    if not python.exists():
        pytest.skip(f"needs Python as a library; there is no {python}")
    settings = {
        "ROS_DISTRO": DISTRIBUTION,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "AMENT_PREFIX_PATH": str(ros.resolve()),
        "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
        "LD_PRELOAD": str(python),
    }
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "ROS_"))}
    port = free_port()
    command = [str(program), "--bind", f"127.0.0.1:{port}", "--no-rosapi", "--log-ansi", "false"]
    log = (folder / "rosbridge.log").open("w+")
    with log, subprocess.Popen(command, env=kept | settings, stdout=log, stderr=log) as process:
        try:
            end = time.monotonic() + 60
            while "server listening" not in (said := (folder / "rosbridge.log").read_text()):
                assert process.poll() is None, said
                assert time.monotonic() < end, said
                time.sleep(0.1)
            yield port
        finally:
            process.kill()


def answered(graph: Transport, told: dict[str, Any]) -> dict[str, Any]:
    """What rosapi answers, by the definitions in rosapi_msgs/srv, from what is discovered by DDS."""
    others, name = graph.others(), told.get("args", {}).get("topic")
    kinds = {each.topic: each.kind.replace("/", "/msg/") for each in others}
    values: dict[str, Any] = {
        "/rosapi/topics": {"topics": list(kinds), "types": list(kinds.values())},
        "/rosapi/publishers": {
            "publishers": [f"/node_{n}" for n, e in enumerate(others) if e.topic == name and e.writes]
        },
        "/rosapi/subscribers": {
            "subscribers": [f"/node_{n}" for n, e in enumerate(others) if e.topic == name and not e.writes]
        },
    }
    service = told["service"]
    answer = {"op": "service_response", "id": told.get("id"), "service": service, "result": service in values}
    return answer | {"values": values.get(service, "no such service")}


@contextlib.contextmanager
def with_rosapi(behind: int, graph: Transport) -> Iterator[int]:
    """What a server and rosapi are together: all but calls of rosapi goes on to the server; yields a port."""
    from websockets.asyncio.client import connect
    from websockets.asyncio.server import ServerConnection, serve

    port, ready, loop = free_port(), threading.Event(), asyncio.new_event_loop()
    ended = asyncio.Event()

    async def talk(client: ServerConnection) -> None:
        async with connect(f"ws://127.0.0.1:{behind}", max_size=None) as link:

            async def back() -> None:
                async for text in link:
                    await client.send(text)

            backwards = asyncio.ensure_future(back())
            async for text in client:
                told = json.loads(text)
                if told.get("op") == "call_service" and told["service"].startswith("/rosapi/"):
                    await client.send(json.dumps(answered(graph, told)))
                else:
                    await link.send(text)
            backwards.cancel()

    async def serving() -> None:
        async with serve(talk, "127.0.0.1", port, max_size=None):
            ready.set()
            await ended.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(serving(),), daemon=True)
    thread.start()
    assert ready.wait(10)
    try:
        yield port
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join(10)
