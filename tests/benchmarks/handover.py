"""How often the scripted operator of two OpenArm arms hands a bar from one hand to the other.

`python -m tests.benchmarks.handover [COUNT]` practises, tries COUNT starts (50) that no rehearsal saw, and prints the
rate with its 95 % Wilson interval and the reasons of failures.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from dextera_build.artifacts.tasks.reasons import spelled, tally
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.runtime.environment import Environment
from dextera_build.statistics import Rate
from tests import openarm_tasks
from tests.robots import robot_recipes


def main(arguments: list[str]) -> None:
    """Print the rate."""
    count = int(arguments[0]) if arguments else 50
    with tempfile.TemporaryDirectory() as scratch:
        robot = robot_recipes.built("openarm_revo1", Path(scratch))
    driver = Driver(Environment(openarm_tasks.handover(robot)))
    operator = planning.practise(driver)
    episodes = [driver.run(operator, driver.environment.draw(seed), origin="operator") for seed in range(count)]
    failed = tally(episode.reason for episode in episodes if not episode.success)
    print(Rate(count - sum(failed.values()), count), spelled(failed, most=5))


if __name__ == "__main__":
    main(sys.argv[1:])
