"""How long nothing takes: `dxb --help` and a build of a twin that is up to date, beside a bare Python."""

from __future__ import annotations

import sys

from tests.e2e.space import Space


def test_cold_processes(tmp_path, clock, capsys):
    space = Space(tmp_path)
    first = space.build("twin/laptop_scene", "--profile", "stub")
    assert first.code == 0, first.err[-2000:]
    dxb = [sys.executable, "-m", "dextera_build"]
    cases = {
        "`python -c pass`": [sys.executable, "-c", "pass"],
        "`dxb --help`": [*dxb, "--help"],
        "no-op `dxb build twin/laptop_scene`": [*dxb, "build", "twin/laptop_scene", "--profile", "stub"],
        "the same, plan and keys made anew": [*dxb, "build", "--check", "twin/laptop_scene", "--profile", "stub"],
    }
    rows = {name: clock(words, tmp_path, space.environment()) for name, words in cases.items()}
    bare = rows["`python -c pass`"][1]
    with capsys.disabled():
        print(f"\n\n{len(first.nodes('ran'))} nodes, wall time of a whole process\n")
        print("| command | least [s] | median [s] | greatest [s] | x bare Python |\n|---|---|---|---|---|")
        for name, (least, median, most) in rows.items():
            print(f"| {name} | {least:.3f} | {median:.3f} | {most:.3f} | {median / bare:.1f} |")
