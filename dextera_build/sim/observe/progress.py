"""Progress of an episode, read from the simulator; used only by rewards, never by a policy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.primitives.base import Primitive, lengths
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.primitives.success import Judge
from dextera_build.sim.runtime.environment import Environment

SHARE = 0.95
"""Distance of the push from the axis, see `Mechanism.pushed_at`."""
BEHIND_M = 0.02
"""Distance behind the link's surface at which a push starts [m]."""
CLEAR_M = 0.06
"""Clearance of a hand from the link's free edge when going around it [m]."""


_Aim = tuple[str, float] | str | None
"""Joint to be pushed and by how much; or the limb whose hand should reach the object; or any."""


class Progress:
    """Follows one environment.

    Args:
        environment: The task; each episode is measured against its own start.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._model = environment.model
        hands = _sites(environment)
        self._tips = np.concatenate(list(hands.values()))
        ends = np.cumsum([len(tips) for tips in hands.values()]).tolist()
        self._hands = {limb: slice(end - len(tips), end) for (limb, tips), end in zip(hands.items(), ends, strict=True)}
        """Limb -> rows of its hand in `_tips`."""
        points = environment.bundle.objects[environment.task.object].points.astype(np.float64)
        self._points = np.ascontiguousarray(points.T)
        self._links: dict[tuple[str, float], _Link] = {}

    def value(self, success: bool, now: TaskState | None = None) -> float:
        """Value of the current state, `now` (N = 1) if the caller has it; see `dextera_build.sim.primitives`."""
        environment = self._environment
        state, start = now or environment.state(), environment.judge.start
        (aim,) = _aims(environment.primitive, start, state)
        reach_m = np.array([self.reach_m(state, 0, aim)])
        return float(environment.primitive.value(reach_m, start, state, np.array([success]))[0])

    def reach_m(self, state: TaskState, number: int, aim: _Aim) -> float:
        """Distance of the fingertips from their target [m].

        For a joint, the distance of the nearest fingertip from the contact point of the push. Otherwise the mean
        distance of fingertips from the object: of one hand, of the nearest, or of every hand that the task names.

        Args:
            state: States, with that of this world.
            number: Number of this world among them.
            aim: What should be reached.
        """
        environment, data = self._environment, self._environment.data
        tips = np.asarray(data.site_xpos[self._tips])
        if isinstance(aim, tuple):
            name, way = aim
            return float(self._link(name).distances(data, way, tips).min())
        distances = self._distances(state, number, tips)
        hands = [self._hands[aim]] if aim in self._hands else self._hands.values()
        # `mean` takes several times as long as sums.
        means = [float(np.add.reduce(distances[hand])) / (hand.stop - hand.start) for hand in hands]
        return float(sum(means) / len(means) if environment.task.limbs else min(means))

    def _link(self, name: str) -> _Link:
        """The link of a joint, at the size of the object in this episode."""
        environment = self._environment
        key = name, environment.start.size_scale.get(environment.task.object, 1.0)
        if key not in self._links:
            self._links = {key: _Link(self._model, name)} | {k: v for k, v in self._links.items() if k[1] == key[1]}
        return self._links[key]

    def _distances(self, state: TaskState, number: int, tips: np.ndarray) -> np.ndarray:
        local = (tips - state.place[number]) @ state.world_from_object[number, :3, :3]
        # NumPy sums over a first axis four times as fast as over a last one of three.
        apart = local.T[:, :, None] - self._points[:, None]
        return np.asarray(np.sqrt((apart * apart).sum(axis=0).min(axis=1)))


def values(worlds: Sequence[Progress], judge: Judge, success: np.ndarray, now: TaskState) -> np.ndarray:
    """Values of the states of several worlds (N,).

    Args:
        worlds: The progress in every world.
        judge: Follows their episodes.
        success: Whether the task is done (N,).
        now: Their states.
    """
    primitive = judge.primitive
    aims = _aims(primitive, judge.start, now)
    reach_m = [each.reach_m(now, number, aims[number]) for number, each in enumerate(worlds)]
    return primitive.value(np.array(reach_m), judge.start, now, success)


def _aims(primitive: Primitive[Any], start: TaskState, now: TaskState) -> list[_Aim]:
    """What should be reached next in every world."""
    pushed, reaching = primitive.pushed(start, now), primitive.reaching(now)
    if pushed is not None:
        return list(zip(*(each.tolist() for each in pushed), strict=True))
    return [None] * len(now.time_s) if reaching is None else reaching.tolist()


def _sites(environment: Environment) -> dict[str, np.ndarray]:
    """Limb -> sites of the fingertips of its hand, if it may do the task, or of its palm if it has none."""
    robot, model = environment.bundle.robot, environment.model
    found = {}
    roles = [name for name in environment.primitive.ordered() if name in robot.limbs]
    for name in roles or environment.task.limbs or robot.limb_names:
        limb = robot.limbs[name]
        tips = limb.tips or (limb.palm,)
        found[name] = np.array([model.site(ROBOT + robot.frames[role]).id for role in tips if role], int)
    return {name: sites for name, sites in found.items() if len(sites)}


class _Link:
    """Distance of a hand from a push of a joint's link from behind."""

    def __init__(self, model: mujoco.MjModel, joint: str) -> None:
        self._mechanism = Mechanism(model, joint)
        self._body = int(model.jnt_bodyid[model.joint(joint).id])
        self._pushed: dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def _push(self, way: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Contact point and the point behind it (2, 3), direction of the push and direction away from the axis (3,).

        All are in the link's frame [m].
        """
        place, along = self._mechanism.pushed_at(way, SHARE)
        outwards = np.cross(along, self._mechanism.axis) * way
        outwards *= np.sign(outwards @ (place - self._mechanism.pivot))
        return np.stack([place, place - BEHIND_M * along]), along, outwards

    def distances(self, data: mujoco.MjData, way: float, points: np.ndarray) -> np.ndarray:
        """Path lengths (N,) [m] from points (N, 3) to the contact point of a push along `way`, all in the world.

        From the side that the link moves towards, the path leads around its free edge, because the link is in between.
        """
        sign = float(np.sign(way))
        if sign not in self._pushed:
            self._pushed[sign] = self._push(sign)
        places, along, outwards = self._pushed[sign]
        turn, place = data.xmat[self._body].reshape(3, 3), data.xpos[self._body]
        surface, target = places @ turn.T + place
        straight = lengths(points - target)
        if not self._mechanism.turns:
            return straight
        edge = target + turn @ outwards * CLEAR_M
        around = lengths(points - edge) + lengths(edge - target)
        before = (points - surface) @ (turn @ along) > 0
        return np.where(before, around, straight)
