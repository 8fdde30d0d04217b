"""What a cluster costs the driver: `python -m tests.benchmarks.cluster [ADDRESS]` prints what docs/cluster.md cites.

Processor time rather than wall-clock time where one process is meant, so that a busy machine changes little. Without
the address of a Ray cluster only those rows are measured that need none.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

from dextera_build.engine.admission import Admission
from dextera_build.engine.capacity import Capacity, Gpu, Needs
from dextera_build.engine.executors.placement import Places, Shape
from dextera_build.engine.executors.ray import RayExecutor
from dextera_build.engine.executors.ray_cluster import Hand, Heard, RayCluster
from dextera_build.engine.executors.ray_worker import Setup, spell
from dextera_build.engine.tasks import Ended, Task
from dextera_build.store.remotes.server import CacheServer
from dextera_build.store.store import Store
from tests.engine.tiny import RUNNER, Record, build, call, facts, graph, text_header

_GPUS, _CORES = 8, 64
_GETS = """
import sys
from dextera_build.store.remotes.http import HttpCache
from dextera_build.store.remotes.remote import Digest
client, digest, count = HttpCache(sys.argv[1]), Digest(sys.argv[2], 0), int(sys.argv[3])
for _ in range(count):
    client.fetch([digest], lambda digest, pieces: [None for _ in pieces])
"""
_PUTS = """
import hashlib, io, sys
from dextera_build.store.remotes.http import HttpCache
from dextera_build.store.remotes.remote import Digest
client, size, count = HttpCache(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
for number in range(count):
    data = number.to_bytes(8, "big") * (size // 8)
    client.send([Digest(hashlib.sha256(data).hexdigest(), size)], lambda digest: io.BytesIO(data))
"""


class _Instant:
    """A cluster whose workers answer at once."""

    address = "127.0.0.1"

    def __init__(self, nodes: int, output: str) -> None:
        amounts = {"CPU": float(_CORES), "GPU": float(_GPUS), "memory": 2.0**40}
        self._nodes = {f"n{number:04}": amounts for number in range(nodes)}
        self._reply = {"output": output, "line": "", "previews": [], "metrics": {}}

    def nodes(self) -> Mapping[str, Mapping[str, float]]:
        return self._nodes

    def hire(self, setup: Setup, shape: Shape, node: str) -> Hand:
        return self

    def run(self, task: Task, fresh: bool, heard: Heard) -> None:
        heard([spell(Ended(task.ticket, 0.0, b"", reply=self._reply))])

    def more(self, heard: Heard) -> None: ...

    def stop(self) -> None: ...

    def kill(self) -> None: ...

    def close(self) -> None: ...


def spent(work: Callable[[], object]) -> float:
    """Processor time that this process needs for `work` [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def executor(nodes: int, count: int, folder: Path) -> float:
    """Submit and poll, all GPUs busy at any time: processor time a call [s]."""
    store = Store(folder)
    output = store.blobs.put(text_header("x"))
    needs, waiting = Needs(1, 1.0, 1), deque(range(count))
    with RayExecutor(_Instant(nodes, output), store, Setup(RUNNER, "")) as pool:

        def submit() -> None:
            ticket = waiting.popleft()
            pool.submit(Task(ticket, "a.b", None, {}, {"x": f"{ticket % 999:064x}"}, "", "", "", needs))

        def work() -> None:
            for _ in range(min(count, nodes * _GPUS)):
                submit()
            done = 0
            while done < count:
                for _ in pool.poll(None):
                    done += 1
                    if waiting:
                        submit()

        return spent(work) / count


def placement(nodes: int, count: int = 200) -> float:
    """Where a new worker goes on a cluster that is half full [s]."""
    places, shape = Places(_Instant(nodes, "").nodes()), Shape((("CPU", 1.0), ("GPU", 1.0)))
    for node in places.nodes:
        places.take(node, Shape((("CPU", _CORES / 2), ("GPU", _GPUS / 2))))
    return spent(lambda: [places.choose(shape, {}) for _ in range(count)]) / count


def admission(gpus: int, count: int = 2000) -> float:
    """What may start next, one GPU each, all busy at any time [s]."""
    line: Admission[int] = Admission(Capacity(gpus * 8, 1e6, tuple(Gpu(str(number), 80.0) for number in range(gpus))))

    def work() -> None:
        for number in range(gpus + count):
            line.wait(number, Needs(1, 1.0, 1))
        for _ in range(gpus):
            line.next()
        for number in range(count):
            line.end(number)
            line.next()

    return spent(work) / (gpus + count)


def driver(count: int, folder: Path) -> float:
    """A whole build of calls without inputs, without Ray and HTTP: processor time a node [s]."""
    store = Store(folder)
    output = store.blobs.put(text_header("x"))
    rule = facts(gpus=1)
    names = tuple(f"n{number}" for number in range(count))
    plan = graph(*(call(name, "const", rule=rule) for name in names), default=names)
    with RayExecutor(_Instant(125, output), store, Setup(RUNNER, "")) as pool:
        return spent(lambda: build(plan, plan.targets["default"], store=store, executor=pool, listen=Record())) / count


def serving(program: str, size: int, count: int, folder: Path) -> float:
    """Give one blob of `size` bytes over and over, or take `count` different ones: processor time a request [s]."""
    store = Store(folder)
    what = store.blobs.put(bytes(size)) if program == _GETS else str(size)
    with CacheServer(store, ("127.0.0.1", 0), secret="x") as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = server.url.replace("://", "://dxb:x@")
        used = spent(lambda: subprocess.run([sys.executable, "-c", program, url, what, str(count)], check=True))
        server.shutdown()
    return used / count


def real(address: str, count: int, folder: Path) -> tuple[float, float]:
    """A build of a chain on a Ray cluster, its first nodes left out: (processor time, wall-clock time) a node [s]."""
    store, warm = Store(folder), graph(call("warm"))
    names = [f"n{number}" for number in range(count)]
    plan = graph(*(call(name, "blob") for name in names), default=tuple(names))
    with RayExecutor(RayCluster(address), store, Setup(RUNNER, "")) as pool:
        build(warm, warm.targets["default"], store=store, executor=pool, listen=Record())
        wall = time.perf_counter()
        used = spent(lambda: build(plan, plan.targets["default"], store=store, executor=pool, listen=Record()))
        return used / count, (time.perf_counter() - wall) / count


def main() -> None:
    """Print name, amount and unit a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address", nargs="?", help="HOST:PORT of a Ray cluster")
    parser.add_argument("--count", type=int, default=4000)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for nodes in (2, 125, 1000):
            print(
                f"executor, {nodes} nodes\t{executor(nodes, args.count, root / f'e{nodes}') * 1e6:.0f}\tµs CPU a call"
            )
            print(f"placement, {nodes} nodes\t{placement(nodes) * 1e6:.0f}\tµs CPU a new worker")
            print(f"admission, {nodes * _GPUS} GPUs\t{admission(nodes * _GPUS) * 1e6:.0f}\tµs CPU a call")
        print(f"build, 1000 GPUs\t{driver(args.count, root / 'd') * 1e6:.0f}\tµs CPU a node")
        for size, count in ((1 << 10, args.count // 4), (1 << 26, 8)):
            for name, program in (("gives", _GETS), ("takes", _PUTS)):
                used = serving(program, size, count, root / f"{name}{size}")
                print(f"server {name} {size} bytes\t{used * 1e6:.0f}\tµs CPU a request")
        if args.address:
            used, wall = real(args.address, args.count // 10, root / "r")
            print(f"on Ray\t{used * 1e6:.0f}\tµs CPU a node\t{wall * 1e6:.0f}\tµs")


if __name__ == "__main__":
    main()
