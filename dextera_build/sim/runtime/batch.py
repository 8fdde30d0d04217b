"""Several worlds of one task, stepped together by MuJoCo Warp in single precision, on a CPU or a GPU.

Warp computes positions and velocities only. An ordinary `Environment` for each world derives the observations and the
state that determines success.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import MachineError, RuleError, install_extra
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.observation import in_worlds
from dextera_build.sim.runtime.environment import Outcome
from dextera_build.sim.runtime.verdicts import Verdicts, side_by_side

CONTACTS, CONSTRAINTS = 256, 1024
"""Capacity for contacts, on average, and for constraint rows in each world; exceeding it is an error."""


class Batch:
    """Worlds of one task that are stepped together, each with its own start and dynamics.

    Args:
        bundle: The task.
        starts: The start of every world; all have objects of the same sizes, because meshes are shared.
        device: A device of Warp, `cpu` or `cuda:0`; None: a GPU if there is one.
        terms: Terms of observations that do not come with dxb.

    Raises:
        MachineError: MuJoCo Warp is not installed.
        RuleError: Sizes differ, or MuJoCo Warp does not support the model.
    """

    def __init__(
        self,
        bundle: TaskBundle,
        starts: Sequence[Start],
        device: str | None = None,
        terms: Sequence[AddedTerm] = (),
    ) -> None:
        warp, self._mjw = installed()
        if any(start.size_scale != starts[0].size_scale for start in starts):
            raise RuleError(
                "worlds of a batch have objects of the same sizes",
                code="DXB-B221",
                hint="give all starts one `size_scale`, or run one batch for each",
            )
        self.worlds = side_by_side(bundle, len(starts), terms)
        """The world of every start, for observations and success."""
        for world, start in zip(self.worlds, starts, strict=True):
            world.begin(start)
        self._verdicts = Verdicts(self.worlds)
        self._device = warp.ScopedDevice(device)
        known = awake(self.worlds[0].model)
        with self._device:
            self._model = self._shared(warp, known)
            self._data = self._mjw.make_data(known, nworld=len(starts), nconmax=CONTACTS, njmax=CONSTRAINTS)
            self._put("qpos", "qvel", "ctrl", "qacc_warmstart")

    def step(self, actions: np.ndarray) -> list[Outcome]:
        """Send joint targets (N, A) [rad] for one control period; a world continues after the end of its episode.

        Raises:
            RuleError: A world has more contacts or constraints than the capacity.
        """
        limited = [world.limited(action) for world, action in zip(self.worlds, actions, strict=True)]
        targets = [world.previous_action if to is None else to for world, to in zip(self.worlds, limited, strict=True)]
        commands = (world.commands(target) for world, target in zip(self.worlds, targets, strict=True))
        with self._device:
            for steps, *_ in zip(*commands, strict=True):
                self._put("ctrl")
                for _ in range(steps):
                    self._mjw.step(self._model, self._data)
            qpos, qvel = self._data.qpos.numpy(), self._data.qvel.numpy()
            self._check_room()
        for world, positions, velocities in zip(self.worlds, qpos, qvel, strict=True):
            world.arrive(positions, velocities)
        pairs = zip(self.worlds, actions, self._verdicts.conclude(limited), strict=True)
        return [outcome or world.broken(action) for world, action, outcome in pairs]

    def observe(self) -> dict[str, np.ndarray]:
        """Deployable term -> its values in all worlds (N, ...) float32."""
        return in_worlds(
            [world.measure() for world in self.worlds],
            [world.previous_action for world in self.worlds],
            [world.goal for world in self.worlds],
            self.worlds[0].added,
        )

    def _shared(self, warp: Any, known: mujoco.MjModel) -> Any:
        """The model on the device, with one copy per world of the fields that differ."""
        shared = put_model(self._mjw, known)
        for name in of_worlds(shared, known):
            values = [getattr(world.model, name) for world in self.worlds]
            if any(not np.array_equal(value, values[0]) for value in values):
                setattr(shared, name, warp.array(np.stack(values), dtype=getattr(shared, name).dtype))
        return shared

    def _put(self, *names: str) -> None:
        """Copy parts of the state of all worlds to the device."""
        for name in names:
            getattr(self._data, name).assign(np.stack([getattr(world.data, name) for world in self.worlds]))

    def _check_room(self) -> None:
        contacts, rows = int(self._data.nacon.numpy()[0]), int(self._data.nefc.numpy().max())
        if contacts > CONTACTS * len(self.worlds) or rows > CONSTRAINTS:
            raise RuleError(
                "a batch has more contacts or constraints than there is room for",
                code="DXB-B223",
                facts={
                    "contacts": f"{contacts}, room for {CONTACTS * len(self.worlds)}",
                    "rows of constraints of one world": f"{rows}, room for {CONSTRAINTS}",
                },
                hint="make a start without so many things in contact",
            )


def awake(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model for MuJoCo Warp, which never resets by itself, and takes longer for sleep than for rest."""
    known = copy.copy(model)
    known.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    known.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    return known


def put_model(mujoco_warp: Any, known: mujoco.MjModel) -> Any:
    """A model on the current device of Warp.

    Raises:
        RuleError: MuJoCo Warp does not support something in it.
    """
    try:
        return mujoco_warp.put_model(known)
    except NotImplementedError as error:
        raise RuleError(
            "MuJoCo Warp does not know something in the model", code="DXB-B222", facts={"MuJoCo Warp": error}
        ) from None


def of_worlds(shared: Any, known: mujoco.MjModel) -> list[str]:
    """Fields of a model on a device whose first axis is the world; all worlds share one row until they are set."""
    names = [field.name for field in fields(shared) if getattr(field.type, "shape", ("",))[0] == "*"]
    return [name for name in names if hasattr(known, name)]


def installed() -> tuple[Any, Any]:
    """The modules `warp` and `mujoco_warp`."""
    try:
        import warp

        warp.config.log_level = warp.LOG_WARNING
        import mujoco_warp
    except ImportError:
        raise MachineError(
            "worlds in a batch need `mujoco_warp`", code="DXB-E302", hint=install_extra("batch")
        ) from None
    return warp, mujoco_warp
