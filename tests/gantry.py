"""An operator of the gantry of `tests.task_bundles`, and demonstrations by it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.geometry import transforms
from dextera_build.geometry.poses import to_matrix
from dextera_build.policy import layout
from dextera_build.sim.control.operator import Aim, Command, State
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.motion import minimum_jerk
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

OPEN, SHUT = (0.05, 0.05), (0.012, 0.012)
"""Targets of the fingers [m]; the box stops them at 20 mm."""
RESET = Reset(position_m=0.02, yaw_rad=0.0, dynamics=0.0, clutter_m=0.0)


@dataclass(frozen=True)
class Move:
    """A motion that ends at rest."""

    place: tuple[float, float, float]
    """Palm in the base, relative to its place over the box, with the fingers at the box's sides [m]."""
    fingers: tuple[float, float]
    seconds: float
    segment: str
    frame: str = ""
    contact: bool = False


LIFT = (
    Move((0.0, 0.0, 0.10), OPEN, 1.0, "approach"),
    Move((0.0, 0.0, 0.0), OPEN, 0.8, "reach", "box"),
    Move((0.0, 0.0, 0.0), SHUT, 0.4, "grasp", "box", True),
    Move((0.0, 0.0, 0.13), SHUT, 0.8, "lift", "box", True),
)
"""Lifts the box by 130 mm."""


class Moves:
    """Moves the palm, without turning it, over the box as it stands at the start of the episode.

    Args:
        environment: The task.
        moves: What to do.
    """

    def __init__(self, environment: Environment, moves: Sequence[Move]) -> None:
        self._environment, self._moves = environment, moves

    def begin(self, state: State) -> None:
        """Read where palm and box are."""
        self._palm = self._environment.palm_poses()[0]
        self._commands = self._walk(state.objects["box"][:3, 3] - [0.0, 0.0, task_bundles.HALF_M])

    def command(self, state: State) -> Command | None:
        """The next step."""
        return next(self._commands, None)

    def _walk(self, box: np.ndarray) -> Iterator[Command]:
        turn = to_matrix(self._palm)[:3, :3]
        over = np.array([box[0], box[1], task_bundles.PALM_M])
        place, fingers = self._palm[:3], np.array(OPEN)
        for move in self._moves:
            target, closed = over + move.place, np.array(move.fingers)
            steps = max(1, round(move.seconds * 20.0))
            for step in range(1, steps + 1):
                part = minimum_jerk(step / steps)
                palm = transforms.rigid(turn, place + part * (target - place))
                aim = Aim(palm, fingers + part * (closed - fingers))
                yield Command({"arm": aim}, move.segment, move.frame, move.contact)
            place, fingers = target, closed


def demonstrations(bundle: TaskBundle, count: int, moves: Sequence[Move] = LIFT) -> Episodes:
    """`count` demonstrations from drawn starts, all successful."""
    driver = Driver(Environment(bundle))
    operator = Moves(driver.environment, moves)
    shown = [driver.run(operator, driver.environment.draw(seed), origin="operator") for seed in range(count)]
    assert all(episode.success for episode in shown), [episode.reason for episode in shown]
    return layout.gathered(bundle, {f"{row:05d}": each for row, each in enumerate(shown)}, {}, count)
