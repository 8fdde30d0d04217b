"""Task bundles as Gymnasium environments.

`dextera_build.envs` gives them names for `gymnasium.make`. Observations are a flat `Dict` whose keys start with their
group: `deployable/joints` also exists on a robot; `privileged/contact` exists only in a simulator and is included on
request. They are the terms of `dextera_build.policy.declared`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import gymnasium
import numpy as np
from gymnasium import spaces

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import ActionKind, TaskBundle, View
from dextera_build.errors import listing
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.observation import Measurement, deployable
from dextera_build.policy.terms import Sensor, Term
from dextera_build.sim.control.action_map import ActionMap
from dextera_build.sim.observe.eyes import Eyes, Picture
from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.observe.sensors import Sensors
from dextera_build.sim.observe.sensors import check as check_sensors
from dextera_build.sim.render import portrait, rendering
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.drawable import drawable
from dextera_build.sim.runtime.environment import Environment, Outcome
from dextera_build.sim.runtime.privileged import Simulated
from dextera_build.sim.runtime.privileged import privileged as privileged_of
from dextera_build.sim.runtime.strata import Stratum
from dextera_build.sim.training.spaces import of_terms, values

DEPLOYABLE, PRIVILEGED = "deployable", "privileged"
"""Groups of observations."""


class TaskEnv(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """One task. Actions are of the task's kind, or of `action`, at the task's rate; `actions.spec` names their numbers.

    An episode is *terminated* by success, or by a non-finite action or state; it is *truncated* by the
    task's time limit, after which its value may be bootstrapped. `info` has `is_success` and `success`,
    `reason` (for ending without success) and `executed` (the targets sent).

    Args:
        bundle: The task, the path of an exported one, or an environment of it, which becomes owned.
        privileged: Whether to include privileged observations.
        views: Cameras by name; None: no images.
        pictures: Outputs of every camera: `deployable/rgb/<camera>`, `deployable/depth/<camera>`, ...
        sensors: Name of a term, or `name/camera`, -> its rate, delay and noise; other terms are exact.
        render_mode: `rgb_array` or None.
        size: (width, height) of rendered pictures [px].
        action: Kind of the actions, see `dextera_build.policy.actions`: `joint`, `delta`, `end_effector`; None: the
            task's.

    Raises:
        RuleError: A sensor measures nothing, there is no such kind of action, or the robot has no palm for it.
        MachineError: The solver of actions of kind `end_effector` is not installed.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  as declared by Gymnasium

    def __init__(
        self,
        bundle: TaskBundle | str | Path | Environment,
        *,
        privileged: bool = False,
        views: Mapping[str, View] | None = None,
        pictures: tuple[Picture, ...] = ("rgb",),
        sensors: Mapping[str, Sensor] | None = None,
        render_mode: str | None = None,
        size: tuple[int, int] = (480, 360),
        action: ActionKind | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"`render_mode` is `rgb_array` or None, not `{render_mode}`")
        if unknown := sorted(set(pictures) - set(get_args(Picture))):
            raise ValueError(f"`pictures` are {listing(get_args(Picture))}, not `{unknown[0]}`")
        check_sensors(sensors or {}, views or {})
        self.environment = bundle if isinstance(bundle, Environment) else Environment(opened(bundle))
        task = self.environment.bundle
        self.actions = ActionMap(task.task, task.robot, action)
        """Conversion of actions to joint targets."""
        self.actions.solve()
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / self.environment.period_s)}
        self._size = size
        self._simulated = Simulated([self.environment]) if privileged else None
        self.progress = Progress(self.environment)
        """Value of the states of its episodes."""
        self._views = views = views or {}
        self._eyes = Eyes(self.environment.model, views, pictures) if views else None
        self._portrait: rendering.Eye | None = None
        lenses = {name: view.camera for name, view in views.items()}
        layout = of_bundle(task, terms=self.environment.specs)
        self.terms = _chosen(layout.terms(lenses, sensors), pictures, privileged)
        """Observed terms, in the order of the observation."""
        self._sensors = Sensors(self.terms, {name: camera.matrix() for name, camera in lenses.items()})
        self._value = self.progress.value(False, self.environment.now)
        self._last = self._observe()
        self.observation_space: spaces.Space[Any] = of_terms(self.terms)
        spec = self.actions.spec
        self.action_space = spaces.Box(spec.lower.astype(np.float32), spec.upper.astype(np.float32), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seed of the start, as in `Environment.reset(seed)`; None: the next of a random sequence, or the first
                seed after it whose start can be drawn.
            options: `{"start": Start}` begins at that start instead; `{"stratum": Stratum}` draws one by stratified
                sampling of a series; `{"share": 0.5}` draws it from half of the task's ranges.

        Raises:
            RuleError: No start without collisions was found; the running episode continues.
        """
        self.begin(seed, options)
        self._last = self._observe()
        return self._last, self.info(False, "", self.environment.previous_action)

    def begin(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begin an episode as `reset` does, without observing it."""
        super().reset(seed=seed)
        start, stratum = ((options or {}).get(name) for name in ("start", "stratum"))
        if isinstance(start, Start):
            self.environment.begin(start)
        else:
            self._reset(seed, stratum, (options or {}).get("share", 1.0))
        start = self.environment.start
        self._sensors.reset(start.seed, start.variation.noise)
        if self._eyes is not None:
            self._eyes.vary(variations.seen(self.environment.bundle, start, self._views))
        self._value = self.progress.value(False, self.environment.now)

    def _reset(self, seed: int | None, stratum: Stratum | None, share: float) -> None:
        def reset(seed: int) -> object:
            return self.environment.reset(seed, stratum, share)

        # Nobody asked for a start of the sequence, so that another one may replace it.
        _ = reset(seed) if seed is not None else drawable(reset, int(self.np_random.integers(2**62)))

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Send an action (N,) for one control period."""
        targets = self.targets(action)
        outcome = targets if isinstance(targets, Outcome) else self.environment.step(targets)
        late, broken = self.ended(outcome)
        reward = 0.0
        if not broken:
            reward = self.earned(self.progress.value(outcome.success, self.environment.now))
            self._last = self._observe()
        info = self.info(outcome.success, outcome.reason, outcome.executed)
        return self._last, reward, outcome.success or broken, late, info

    def targets(self, action: np.ndarray) -> np.ndarray | Outcome:
        """The joint targets (A,) [rad] of an action, or the outcome of one that cannot be sent."""
        environment, action = self.environment, np.asarray(action, np.float64)
        if fault := self.actions.fault(action):
            return Outcome(False, True, fault, environment.previous_action.copy())
        return self.actions.targets(action, environment.previous_action)

    def ended(self, outcome: Outcome) -> tuple[bool, bool]:
        """Whether the time limit ended the episode, and whether a fault did, after which nothing is observed."""
        failed = outcome.over and not outcome.success
        return failed and self.late, failed and not self.late

    def earned(self, value: float) -> float:
        """The reward of a period after which the state has this value."""
        reward, self._value = value - self._value, value
        return float(reward)

    @property
    def value(self) -> float:
        """Value of the current state, whose change is the reward; see `dextera_build.sim.primitives.stages`."""
        return self._value

    @property
    def late(self) -> bool:
        """Whether the task's time limit has passed."""
        environment = self.environment
        return bool(environment.steps * environment.period_s >= environment.task.timeout_s - 1e-9)

    def render(self) -> np.ndarray | None:
        """Render the scene from in front of the table, (H, W, 3) uint8 sRGB, or None without a render mode."""
        if self.render_mode is None:
            return None
        model, data = self.environment.model, self.environment.data
        if self._portrait is None:
            self._portrait = rendering.Eye(model, *portrait.stand(model, data, *self._size))
        return self._portrait.rgb(data)

    def close(self) -> None:
        """Free the renderer."""
        if self._eyes is not None:
            self._eyes.close()
        if self._portrait is not None:
            self._portrait.__exit__(None, None, None)
        self._portrait = None

    def measured(self) -> Measurement:
        """What the sensors measure now; they remember, so that this is asked once in a period."""
        environment = self.environment
        frames = self._eyes.look(environment.data) if self._eyes else None
        return self._sensors.measure(environment.measure(frames), environment.steps * environment.period_s)

    def _observe(self) -> dict[str, np.ndarray]:
        environment = self.environment
        shown = deployable(self.measured(), environment.previous_action, environment.goal, environment.added)
        return values(self.terms, shown, privileged_of(self._simulated) if self._simulated else None)

    def info(self, success: bool, reason: str, executed: np.ndarray) -> dict[str, Any]:
        """Further facts about a period, see the class."""
        return {"is_success": success, "success": success, "reason": reason, "executed": np.array(executed)}


def opened(bundle: TaskBundle | str | Path) -> TaskBundle:
    """A task, loaded if given as a path.

    Raises:
        ArtifactError: The file is damaged, or contains something else.
    """
    return bundle if isinstance(bundle, TaskBundle) else unpack(TaskBundle, Path(bundle).read_bytes(), f"`{bundle}`")


def _chosen(terms: tuple[Term, ...], pictures: tuple[Picture, ...], privileged: bool) -> tuple[Term, ...]:
    """The terms of an environment among all of its task."""
    readers = {"policies", "critics"} if privileged else {"policies"}
    return tuple(
        term
        for term in terms
        if term.declared.seen_by in readers and (not term.camera or term.declared.name in pictures)
    )
