"""A twin instead of trivial nodes."""

from __future__ import annotations

from collections.abc import Iterator

from tests.benchmarks.engine.extras.row import Bench, Row, of_cost

RECIPE = "twin/laptop_scene"


def twin(bench: Bench) -> Iterator[Row]:
    """`twin/laptop_scene` with the stub profile, and `dxb plan` of it."""
    for tool in bench.present("dxb"):
        folder = bench.work / "twin"
        folder.mkdir()
        (folder / "dxb.toml").write_text('cache = "cache"\nprofile = "stub"\n')
        env = tool.environment(folder)
        lines = {
            "build, all run": (["build", RECIPE, "--console", "none"], 1),
            "build, no change": (["build", RECIPE], None),
            "build --check, plan and keys made anew": (["build", "--check", RECIPE], None),
            "plan": (["plan", RECIPE], None),
        }
        for what, (words, times) in lines.items():
            yield of_cost(f"{RECIPE}: {what}", tool.name, bench.quickest([*tool.words(), *words], folder, times, **env))
