"""One artifact of many files, beside what the machine needs to read and to copy them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.engine.extras.row import Bench, Row, of_cost
from tests.benchmarks.engine.measure import Cost

FILES, BYTES, PER_FOLDER = 100_000, 1_000, 1_000

RULE = '''"""bench.same: a folder, as it came."""

from __future__ import annotations

from dextera_build.artifacts.base import Folder
from dextera_build.rule import Context, Options, rule


class SameOptions(Options):
    """Options of bench.same."""


@rule(version=1)
def same(ctx: Context, folder: Folder, *, options: SameOptions) -> Folder:
    """Return the folder."""
    return folder
'''


def large_folder(bench: Bench) -> Iterator[Row]:
    """Hash and store a folder of many files, look at it again, restore it."""
    root = bench.work / "folder"
    _write(root, FILES)
    cores = len(os.sched_getaffinity(0))
    hashing = f"find tree -type f -print0 | xargs -0 -n 500 -P {cores} sha256sum > /dev/null"
    yield _rate("read and hash", "sha256sum", bench.quickest(["sh", "-c", hashing], root))
    yield _rate("copy", "cp -r", bench.quickest(["cp", "-r", "tree", "copy"], root, 1))
    for tool in bench.present("dxb"):
        command, env = tool.command(root), tool.environment(root)
        stored = bench.quickest(command, root, 1, **env)
        yield _rate("hash, store, through one node, export", tool.name, stored)
        if not stored.ok:
            continue
        yield _rate("nothing changed", tool.name, bench.quickest(command, root, **env))
        shutil.rmtree(root / "cache" / "out", ignore_errors=True)
        yield _rate("restore", tool.name, bench.quickest(command, root, 1, **env), _differs(root))
    shutil.rmtree(root)


def _write(root: Path, files: int) -> None:
    for number in range(files):
        folder, name = divmod(number, PER_FOLDER)
        if not name:
            (root / "tree" / f"d{folder}").mkdir(parents=True)
        (root / "tree" / f"d{folder}" / f"f{name}").write_bytes(f"{number} ".encode().ljust(BYTES, b"."))
    (root / "rules" / "bench").mkdir(parents=True)
    (root / "rules" / "bench" / "same.py").write_text(RULE)
    (root / "recipes").mkdir()
    (root / "recipes" / "graph.yaml").write_text(
        "inputs:\n  tree: tree\nnodes:\n  same: {rule: bench.same, folder: $tree}\ntargets:\n  default: [same]\n"
    )
    (root / "dxb.toml").write_text('cache = "cache"\n')


def _differs(root: Path) -> str:
    """What is not as it was, or ""."""
    made = root / "cache" / "out" / "graph" / "same"
    for number in range(0, FILES, 997):
        name = f"d{number // PER_FOLDER}/f{number % PER_FOLDER}"
        if not (made / name).exists() or (made / name).read_bytes() != (root / "tree" / name).read_bytes():
            return f"wrong: {name}"
    return ""


def _rate(what: str, tool: str, cost: Cost, note: str = "") -> Row:
    said = note or f"{cost.seconds:.1f} s, {cost.rss_mib:.0f} MiB"
    return of_cost(f"{FILES:,} files of {BYTES:,} bytes: {what}", tool, cost, FILES / cost.seconds, "files/s", said)
