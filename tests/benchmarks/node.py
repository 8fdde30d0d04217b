"""What a trivial node costs: `python -m tests.benchmarks.node`; `--beside FOLDER` measures another checkout, too.

The layered graph of `tests.benchmarks.engine` is built cold in a small and in a large size, each build in a process of
its own, and the difference is shared out among the nodes that the large one has more. So no start-up is counted, of dxb
or of workers, and no planning and no export either: the scheduler is measured within `engine.run.build` alone.

Processor times are the least of all repeats; two checkouts take turns, so that other work on the machine hits both.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

REPO = Path(__file__).resolve().parents[2]
_SMALL = 200
_TITLES = (
    "checkout",
    "scheduler [ms]",
    "workers [ms]",
    "scheduler + workers / jobs [ms]",
    "wall [ms]",
    "waits",
    "memory [MiB]",
)


def main() -> None:
    """Measure and print a table."""
    args = _arguments()
    codes = [REPO, *(folder.resolve() for folder in args.beside)]
    sizes = (_SMALL, _SMALL + args.nodes)
    found: dict[tuple[Path, int], list[dict[str, float]]] = {(code, size): [] for code in codes for size in sizes}
    with tempfile.TemporaryDirectory(prefix="dxb-bench-", dir=args.work) as folder:
        for repeat in range(args.repeats):
            for (code, size), costs in found.items():
                costs.append(_measure(code, size, Path(folder), args))
                print(f"{repeat + 1} of {args.repeats}: {code}, {size} nodes", file=sys.stderr)
    print("| " + " | ".join(_TITLES) + " |")
    print("|" + " --- |" * len(_TITLES))
    for code in codes:
        small, large = (_least(found[code, size]) for size in sizes)
        each = {name: (large[name] - small[name]) / args.nodes for name in large}
        own, others = each["scheduler"] * 1e3, each["workers"] * 1e3
        row = [f"{time_ms:.3f}" for time_ms in (own, others, own + others / args.jobs, each["wall"] * 1e3)]
        row += [f"{each['waits']:.2f}", f"{large['memory_mib']:.0f}"]
        print(f"| {_version(code)} | " + " | ".join(row) + " |")


def _least(costs: list[dict[str, float]]) -> dict[str, float]:
    return {name: min(cost[name] for cost in costs) for name in costs[0]}


def _measure(code: Path, size: int, work: Path, args: argparse.Namespace) -> dict[str, float]:
    from tests.benchmarks.engine import dags, measure
    from tests.benchmarks.engine.tools.dxb import Dxb

    project, dag = work / "project", dags.SHAPES[args.shape](size)
    (project / "leaves").mkdir(parents=True)
    for name, value in dag.leaves.items():
        dags.write_leaf(project, name, value)
    Dxb().write(dag, project)
    words = ["build", "graph", "--console", args.console, "--jobs", str(args.jobs)]
    environment = measure.environment(PYTHONPATH=str(code), **Dxb().environment(project))
    inside = [sys.executable, str(Path(__file__).resolve()), "--inside", str(work / "cost.json"), *words]
    try:
        done = subprocess.run(inside, cwd=project, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"the build with {code} failed:\n{done.stderr}")
        cost: dict[str, float] = json.loads((work / "cost.json").read_text())
    finally:
        shutil.rmtree(project)
    if cost["ran"] != size:
        raise SystemExit(f"{cost['ran']:g} nodes ran, not {size}")
    return cost


def _inside(target: str, words: list[str]) -> int:
    """Run `dxb` with these words, and write to `target` what it cost; dxb is that of the module search path."""
    from dextera_build.cli.main import main as dxb
    from dextera_build.engine import run

    found: dict[str, float] = {}
    build = run.build

    def measured(*arguments: Any, **more: Any) -> run.RunResult:
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
        result = build(*arguments, **more)
        after = resource.getrusage(resource.RUSAGE_SELF)
        found["wall"] = time.perf_counter() - began
        found["scheduler"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        found["waits"] = after.ru_nvcsw - before.ru_nvcsw
        found["ran"] = sum(record.status == "ran" for record in result.nodes.values())
        found["memory_mib"] = _peak_mib()
        return result

    run.build = measured  # `build.build` imports it when it builds
    code = dxb(words)
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    found["workers"] = children.ru_utime + children.ru_stime
    Path(target).write_text(json.dumps(found))
    return code


def _peak_mib() -> float:
    # Not from `getrusage`: that has the peak of the process that started this one, too.
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))


def _version(code: Path) -> str:
    command = ["git", "-C", str(code), "describe", "--always", "--dirty", "--exclude=*"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or str(code)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.node", description=__doc__)
    parser.add_argument(
        "--nodes", type=int, default=3000, help=f"how many nodes more than {_SMALL} the large graph has"
    )
    parser.add_argument("--shape", default="layered", help="layered, wide or chain")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--console", default="none", help="none, plain or jsonl")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--beside", type=Path, action="append", default=[], help="another checkout to measure, too")
    parser.add_argument("--work", type=Path, help="where the projects are made; default: the temporary folder")
    return parser.parse_args()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--inside"]:
        sys.path[0] = os.environ["PYTHONPATH"]  # instead of the folder of this file
        sys.exit(_inside(sys.argv[2], sys.argv[3:]))
    main()
