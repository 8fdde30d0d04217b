"""Print what happens after a thousand random starts of built tasks while the robot holds still.

dxb build task/ob/lift_toy_bus:task task/kl/lift_mustard_bottle:task
python -m tests.benchmarks.starts task/ob/lift_toy_bus:task task/kl/lift_mustard_bottle:task
"""

from __future__ import annotations

import argparse

from dextera_build.api import Project
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment
from tests import held_starts


def row(name: str, bundle: TaskBundle, count: int) -> str:
    """One task."""
    environment = Environment(bundle)
    tried = list(held_starts.held(environment, held_starts.drawn(environment, count)))
    exploded = [each for each in tried if each.exploded]
    fastest, deepest = max(each.fastest_m_s for each in tried), max(each.deepest_m for each in tried)
    told = "; ".join(map(str, exploded[:3]))
    return f"| `{name}` | {len(exploded)} of {count} | {fastest:.3f} | {1000 * deepest:.2f} | {told} |"


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("targets", nargs="+", help="targets that return a TaskBundle")
    options.add_argument("--starts", type=int, default=1000)
    given = options.parse_args()
    project = Project.find()
    print(
        "| task | exploded | fastest object [m/s] | deepest penetration [mm] | |",
        "| --- | --- | --- | --- | --- |",
        sep="\n",
    )
    for target in given.targets:
        bundle = project.get(target)
        assert isinstance(bundle, TaskBundle)
        print(row(target, bundle, given.starts), flush=True)


if __name__ == "__main__":
    main()
