"""Worlds of a task in which a policy practises, on one device: decisions, observations and rewards are tensors.

They are what `sim.training.practice` does with MuJoCo, in single precision. Objects have the sizes of the photograph,
because worlds share meshes, and all worlds have the goal of the task.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass

import torch
from torch import Tensor

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy import contract as contracts
from dextera_build.sim.model.model import untextured
from dextera_build.sim.runtime.drawable import drawable
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.tensors.judge import TensorJudge, filled, tensors
from dextera_build.sim.training.tensors.physics import Physics
from dextera_build.sim.training.tensors.reach import Reach
from dextera_build.sim.training.tensors.reading import Episodes, Reading
from dextera_build.sim.training.tensors.steering import TensorSteering


@dataclass(frozen=True)
class Step:
    """One decision in every world."""

    seen: Tensor
    """Observations (N, K + P), of a new episode where one was over."""
    last: Tensor
    """Observations (N, K + P) before that, the last of an episode that is over."""
    rewards: Tensor
    """Change of the value (N,)."""
    ended: Tensor
    """Whether success or a fault ended the episode (N,) bool."""
    late: Tensor
    """Whether the time limit ended it (N,) bool; its value may be bootstrapped."""
    success: Tensor
    """Whether the task is done (N,) bool."""


class TensorWorlds:
    """Observations (N, K + P): K deployable numbers, then P privileged ones, as those of `Practices`.

    Args:
        bundle: The task.
        contract: Inputs and outputs of the policy.
        count: N, the number of worlds.
        seed: Seed of the starts, and of which world begins from which.
        pool: Number of starts that worlds begin from.
        device: `cpu` or `cuda`.

    Raises:
        MachineError: MuJoCo Warp is not installed.
        RuleError: MuJoCo Warp does not support the model, or the task draws goals.
    """

    judge: TensorJudge
    """Follows the episodes of all worlds."""
    _episodes: Episodes
    _earlier: Tensor
    """The targets before the last ones (N, A) [rad]."""
    _plain: int

    def __init__(
        self, bundle: TaskBundle, contract: PolicyContract, count: int, seed: int, *, pool: int, device: str
    ) -> None:
        self._bundle = _equal(bundle)
        self._environment = environment = Environment(self._bundle)
        self._physics = Physics(environment, count, device)
        self.device, self.count = self._physics.device, count
        """Where the tensors are, and N."""
        with self.here():
            self._steering = TensorSteering(bundle.robot, contract, self.device)
            self._reading = Reading(environment, self._physics, contract, self._steering.limbs)
            self._reach = Reach(environment, self._physics)
            self._seed, self._pool, self._random = seed, pool, torch.Generator(self.device)
            self.decisions, self.every = self._steering.size, self._steering.every
            """Size of a decision, and the control periods that it lasts."""
            self._limits = self._on([(joint.lower, joint.upper) for joint in bundle.robot.joints]).T
            self._fastest = self._on([joint.velocity for joint in bundle.robot.joints]) * environment.period_s
            pieces, late = self._physics.pieces, bundle.latency_s / environment.period_s
            self._parts = self._on([[[piece / pieces - late]] for piece in range(1, pieces + 1)])
            """Share of the way of each command; below 0 the target before is active, see `Environment.commands`."""
            self._done = 0
            self.widen(1.0)
            self.reset()
            seen = self.seen()
            teaches = int(contract.settings.get(contracts.PRIVILEGED, 0))
            self.size, self.public = seen.shape[1], self._plain + teaches
            """K + P, and the number of the first numbers that the policy sees."""

    def here(self) -> AbstractContextManager[None]:
        """A context in which torch works in the stream of the simulator."""
        return self._physics.here()

    def widen(self, share: float) -> None:
        """Draw the starts of further episodes from this fraction of the task's ranges."""
        environment, drawn = self._environment, list[Start]()
        for number in range(self._pool):
            drawable(lambda seed: environment.reset(seed, share=share), seed_of(self._seed, "start", number))
            drawn.append(environment.start)
        self._physics.draw(drawn)
        self._starts = drawn

    def reset(self) -> Tensor:
        """Begin an episode in every world; the observations (N, K + P)."""
        with self.here():
            every = torch.ones(self.count, dtype=torch.bool, device=self.device)
            self._rows = torch.zeros(self.count, dtype=torch.int64, device=self.device)
            self._begin(every, first=True)
            return self.seen()

    def step(self, decisions: Tensor) -> Step:
        """Execute one decision (N, M) in every world, and begin the next episode where one is over."""
        with self.here():
            return self._step(decisions)

    def _step(self, decisions: Tensor) -> Step:
        joints = self._physics["qpos"][:, self._reading.joints]
        goals = self._steering.targets(decisions, self._episodes.sent, joints)
        before = value = self._episodes.value
        success = late = broken = torch.zeros_like(value, dtype=torch.bool)
        for goal in goals:
            over = success | late | broken
            self._advance(goal)
            now = self._reading.state(self._episodes)
            done = self.judge.update(now)
            fault = self._reading.broken()
            worth = self.judge.value(self._reach.distances(self.judge, now), now, done)
            value = torch.where(over | fault, value, worth)
            timed = self._episodes.steps * self._environment.period_s >= self._environment.task.timeout_s - 1e-5
            success, broken = success | (done & ~over & ~fault), broken | (fault & ~over)
            late = late | (timed & ~over & ~success & ~broken)
        self._episodes = Episodes(self._episodes.steps, self._episodes.sent, self._episodes.base, value)
        last = self.seen()
        self._done += 1
        self._begin(success | late | broken)
        return Step(self.seen(), last, value - before, success | broken, late, success)

    def starts(self) -> list[Start]:
        """The start of the running episode of every world; it copies to the host."""
        return [self._starts[row] for row in self._rows.tolist()]

    def stepped(self, periods: int, now: Callable[[], float]) -> float:
        """Seconds by `now` of control periods of physics alone, in which the last targets stay; for measurements."""
        commands = self._episodes.sent.expand(self._physics.pieces, -1, -1)
        before = now()
        for _ in range(periods):
            self._physics.advance(commands)
        return now() - before

    def check(self) -> None:
        """Compare what happened with the capacity for contacts; it copies to the host, so ask once in a while.

        Raises:
            RuleError: See `Physics.check_room`.
        """
        self._physics.check_room()

    @property
    def state(self) -> dict[str, Tensor]:
        """Everything that the further episodes depend on, of which the starts are drawn again."""
        own = {"rows": self._rows, "earlier": self._earlier, "done": torch.tensor(self._done)}
        parts = {"physics": self._physics.state, "judge": self.judge.state, "episodes": self._episodes, "own": own}
        return {name: each.contiguous() for name, each in tensors(parts)}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Go on from a state, exactly."""
        self._done = int(state[".own.done"])
        own = {"rows": self._rows, "earlier": self._earlier}
        parts = filled({"judge": self.judge.state, "episodes": self._episodes, "own": own}, state)
        self.judge.state, self._episodes = parts["judge"], parts["episodes"]
        self._rows, self._earlier = parts["own"]["rows"], parts["own"]["earlier"]
        # Twice, because what the solver starts from is replaced when positions of bodies are computed.
        self._physics.put(state)
        self._physics.refresh()
        self._physics.put(state)

    def _begin(self, worlds: Tensor, first: bool = False) -> None:
        self._random.manual_seed(seed_of(self._seed, "rows", self._done))
        rows = torch.randint(self._physics.starts, (self.count,), generator=self._random, device=self.device)
        self._rows = torch.where(worlds, rows, self._rows)
        self._physics.begin(worlds, self._rows)
        ctrl = self._physics.targets()
        sent = ctrl if first else torch.where(worlds[:, None], ctrl, self._episodes.sent)
        self._earlier = sent if first else torch.where(worlds[:, None], ctrl, self._earlier)
        zero = torch.zeros(self.count, device=self.device)
        steps = zero if first else torch.where(worlds, zero, self._episodes.steps)
        base = self._physics.base(self._rows)
        self._episodes = Episodes(steps, sent, base, zero if first else self._episodes.value)
        now = self._reading.state(self._episodes)
        if first:
            self.judge = TensorJudge(self._bundle.task, now, self._bundle.objects)
        else:
            self.judge.begin(worlds, now)
        worth = self.judge.value(self._reach.distances(self.judge, now), now, torch.zeros_like(worlds))
        value = worth if first else torch.where(worlds, worth, self._episodes.value)
        self._episodes = Episodes(steps, sent, base, value)

    def _advance(self, goal: Tensor) -> None:
        """One control period on the way to joint targets (N, A) [rad], within ranges and speeds."""
        before, earlier = self._episodes.sent, self._earlier
        near = torch.minimum(torch.maximum(goal, before - self._fastest), before + self._fastest)
        target = torch.minimum(torch.maximum(near, self._limits[0]), self._limits[1])
        sent = before + (target - before) * self._parts
        sent = torch.where(self._parts < 0, earlier + (before - earlier) * (1 + self._parts), sent)
        self._physics.advance(sent)
        self._earlier = before
        self._episodes = Episodes(self._episodes.steps + 1, target, self._episodes.base, self._episodes.value)

    def seen(self) -> Tensor:
        """Observations of the worlds as they are (N, K + P)."""
        plain = self._reading.inputs(self._episodes)
        joints = self._physics["qpos"][:, self._reading.joints]
        known = torch.cat([plain, self._steering.places(joints)], dim=1)
        self._plain = known.shape[1]
        # Of a world that diverged, nothing is learned.
        return torch.cat([known, self._reading.insight(self._episodes)], dim=1).nan_to_num(0.0, 0.0, 0.0)

    def _on(self, values: object) -> Tensor:
        return torch.tensor(values, dtype=torch.float32, device=self.device)


def _equal(bundle: TaskBundle) -> TaskBundle:
    """The task without what cannot differ from world to world."""
    reset = bundle.task.reset
    if reset.goal_m or reset.goal_rad:
        raise RuleError(
            "all worlds on tensors have one goal, and the task draws it",
            code="DXB-B535",
            facts={"reset": f"goal_m {reset.goal_m:g}, goal_rad {reset.goal_rad:g}"},
            hint="train with the backend `sb3`, or set both to 0",
        )
    objects = {name: thing.model_copy(update={"scale_sigma": 0.0}) for name, thing in bundle.objects.items()}
    return bundle.model_copy(update={"objects": objects, "model": untextured(bundle.model)})
