"""A twin instead of trivial nodes: builds, and what verbs take of the processor."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from tests.benchmarks.engine.extras.row import Bench, Row, of_cost

RECIPE = "twin/laptop_scene"


PYTHON = "from dextera_build import Project; Project.find().build('twin/laptop_scene')"


def twin(bench: Bench) -> Iterator[Row]:
    """`twin/laptop_scene` with the stub profile, and verbs that read it."""
    for tool in bench.present("dxb"):
        folder = bench.work / "twin"
        folder.mkdir()
        (folder / "dxb.toml").write_text('cache = "cache"\nprofile = "stub"\n')
        env = tool.environment(folder)
        lines = {
            "build, all run": (["build", RECIPE, "--console", "none"], 1),
            "build, no change": (["build", RECIPE], None),
            "build --check": (["build", "--check", RECIPE], None),
        }
        for what, (words, times) in lines.items():
            yield of_cost(f"{RECIPE}: {what}", tool.name, bench.quickest([*tool.words(), *words], folder, times, **env))
        verbs = {
            "plan, a new request": [*tool.words(), "plan", RECIPE, "--set", "settle.seconds=2.5"],
            **{verb: [*tool.words(), verb, RECIPE] for verb in ("plan", "why", "check", "log")},
            "build in Python, no change": [sys.executable, "-c", PYTHON],
        }
        for what, words in verbs.items():
            cost = bench.quickest(words, folder, 1 if "new" in what else None, **env)
            yield of_cost(f"{RECIPE}: {what}", tool.name, cost, cost.cpu, "s of processor time")
