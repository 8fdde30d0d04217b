"""A data set of episodes with video, through the store, and what each step costs.

`python -m tests.benchmarks.data_set` writes it, reads random batches of it and exports it, each step in a process of
its own, and prints the rows of the table in `dextera_build/docs/benchmarks/data_set.md`.
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

import psutil

PHASES = ("write", "read", "unpack", "sample", "export", "lerobot")
READER = Path(__file__).with_name("lerobot_read.py")
SAMPLES_S = 0.1
"""Time between two looks at the memory of a step [s]."""


def measured(command: list[str], env: dict[str, str] | None = None) -> dict[str, float]:
    """What a step printed, with the processor time and the greatest memory of its processes together [MiB].

    Pages of mapped files do not count.

    Raises:
        subprocess.CalledProcessError: It failed.
    """
    before = _processor_s()
    step = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env)
    family, peak = psutil.Process(step.pid), 0
    while step.poll() is None:
        peak = max(peak, _own(family))
        time.sleep(SAMPLES_S)
    out, _ = step.communicate()
    if step.returncode:
        raise subprocess.CalledProcessError(step.returncode, command)
    more = {"processor [s]": round(_processor_s() - before, 1), "peak [MiB]": round(peak / 2**20)}
    return json.loads(out.splitlines()[-1]) | more


def _processor_s() -> float:
    """Processor time of all steps that have ended [s], with their imports."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _own(family: psutil.Process) -> int:
    """Memory of a process and all below it without mapped files, whose pages the system takes back at will [bytes]."""
    total = 0
    try:
        for process in (family, *family.children(recursive=True)):
            info = process.memory_info()
            total += info.rss - info.shared
    except psutil.NoSuchProcess:
        pass  # one has just ended; the next look counts the others
    return total


def main() -> None:
    """Measure every step, or run one of them in this process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=390)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--batches", type=int, default=20)
    parser.add_argument("--batch", type=int, default=32, help="samples per batch, each of two cameras")
    parser.add_argument("--processes", type=int, default=2, help="how many write at a time")
    parser.add_argument("--root", type=Path, help="where to write, kept; a temporary folder otherwise")
    parser.add_argument("--phases", nargs="+", default=PHASES, help="which steps")
    parser.add_argument(
        "--reader", type=Path, help="folder with the packages of LeRobot, whose reader is then measured"
    )
    parser.add_argument("--python", type=Path, help="interpreter of an environment with LeRobot, for the same")
    parser.add_argument("--backend", default="pyav", help="LeRobot's decoder of videos")
    parser.add_argument("--within", action="store_true", help="run the step in this process")
    args = parser.parse_args()
    if args.within:
        print(json.dumps(run(args)))
        return
    root = args.root or Path(tempfile.mkdtemp(prefix="data-set-"))
    root.mkdir(parents=True, exist_ok=True)
    own = [f"--{name}={getattr(args, name)}" for name in ("episodes", "frames", "batches", "batch", "processes")]
    own += ["--within", "--root", str(root), "--size", *map(str, args.size), "--phases"]
    try:
        for phase in args.phases:
            print(json.dumps(measured([sys.executable, "-m", "tests.benchmarks.data_set", *own, phase])), flush=True)
        if args.reader or args.python:
            python = [str(args.python or sys.executable), str(READER), str(root / "lerobot")]
            env = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(root / "home")}
            env |= {"PYTHONPATH": str(args.reader)} if args.reader else {}
            print(json.dumps(measured([*python, str(args.batches), str(args.batch), args.backend], env)), flush=True)
    finally:
        if not args.root:
            shutil.rmtree(root)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run a step; return its name, the number of pictures and the time that it took [s]."""
    from tests.benchmarks.data_set import phases

    (phase,) = args.phases
    opened, begun = 0.0, time.perf_counter()
    if phase == "write":
        count = phases.write(args.root, args.episodes, args.frames, tuple(args.size), args.processes)
    elif phase == "read":
        count = phases.read(args.root, args.batches, args.batch)
    elif phase == "sample":
        sampler = phases.Sampler(args.root)
        opened, begun = round(time.perf_counter() - begun, 2), time.perf_counter()
        count = sampler.read(args.batches, args.batch)
    else:
        whole = {"unpack": phases.unpack, "export": phases.export, "lerobot": phases.as_lerobot}
        count = whole[phase](args.root)
    seconds = time.perf_counter() - begun
    facts = {"step": phase, "pictures": count, "seconds": round(seconds, 2), "pictures/s": round(count / seconds, 1)}
    return facts | ({"opened [s]": opened} if opened else {})


if __name__ == "__main__":
    main()
