"""Physics of N worlds of a task by MuJoCo Warp, whose states are tensors of torch on the same device.

Starts, with their masses, frictions, gains and bases, are drawn beforehand by MuJoCo; a world that begins takes one of
them over on the device. On a GPU the steps of a control period are one CUDA graph.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.errors import MachineError, RuleError
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime import batch
from dextera_build.sim.runtime.environment import Environment

CONTACTS, CONSTRAINTS = 128, 512
"""Capacity for contacts, on average, and for constraint rows in each world; exceeding it is an error."""


class Physics:
    """N worlds that are stepped together.

    Args:
        environment: One world of the task, which says what a start changes in a model.
        count: N.
        device: `cpu`, or `cuda` for a GPU.

    Raises:
        MachineError: MuJoCo Warp is not installed, or the memory does not hold so many worlds.
        RuleError: MuJoCo Warp does not support the model.
    """

    def __init__(self, environment: Environment, count: int, device: str) -> None:
        self._warp, self._mjw = batch.installed()
        self.device, self.count = torch.device(device), count
        self._environment = environment
        self._stream: Any = torch.cuda.Stream() if self.device.type == "cuda" else None  # type: ignore[no-untyped-call]
        self._graphs: dict[str, Any] = {}
        """Work -> its CUDA graph."""
        known = batch.awake(environment.model)
        with self.here():
            self._model = batch.put_model(self._mjw, known)
            self._model.opt.deterministic = self._stream is not None  # on a CPU, kernels run one after the other
            self._data = self._room(known)
            self._ids = self._warp.array(np.arange(self._data.naconmax), dtype=int)
            self._forces = self._warp.zeros(self._data.naconmax, dtype=self._warp.spatial_vector)
        self._fields = batch.of_worlds(self._model, known)
        self._own: dict[str, Tensor] = {}
        """Fields of the model that differ from world to world."""
        self._pool: dict[str, Tensor] = {}
        joints = [environment.model.actuator(ROBOT + joint.name).id for joint in environment.bundle.robot.joints]
        self._actuators = torch.tensor(joints, device=self.device)
        # As many pieces of a period as `Environment.commands` has.
        self._ramp = list(environment.commands(environment.previous_action))
        with self.here():
            self._sent = torch.zeros(len(self._ramp), count, environment.model.nu, device=self.device)
            self._commands = [self._warp.from_torch(each) for each in self._sent]

    def _room(self, known: mujoco.MjModel) -> Any:
        """The state of all worlds."""
        try:
            return self._mjw.make_data(known, nworld=self.count, nconmax=CONTACTS, njmax=CONSTRAINTS)
        except RuntimeError as error:
            if "allocate" not in str(error):
                raise
            raise MachineError(
                f"the memory of `{self.device}` does not hold {self.count:,} worlds",
                code="DXB-E389",
                facts={"Warp": str(error).splitlines()[0]},
                hint=f"worlds: {max(1, self.count // 2)}",
            ) from None

    @contextmanager
    def here(self) -> Iterator[None]:
        """In the block, Warp and torch work on this device and, on a GPU, in one stream that waits for that outside."""
        with ExitStack() as stack:
            stack.enter_context(self._warp.ScopedDevice(str(self.device)))
            outside = torch.cuda.current_stream() if self._stream is not None else None
            if outside is not None and outside != self._stream:
                self._stream.wait_stream(outside)
                stack.enter_context(torch.cuda.stream(self._stream))
                stack.enter_context(self._warp.ScopedStream(self._warp.stream_from_torch(self._stream)))
            yield
        if outside is not None and outside != self._stream:
            outside.wait_stream(self._stream)

    def draw(self, starts: Sequence[Start]) -> None:
        """Replace the starts that worlds begin from."""
        worlds, rows = self._environment, list[dict[str, np.ndarray]]()
        for start in starts:
            worlds.begin(start)
            rows.append({name: _kept(getattr(worlds.model, name), rows, name) for name in self._fields})
            rows[-1] |= {"": start.qpos, "ctrl": start.ctrl, "base": np.linalg.inv(worlds.base_from_world)}
        self._pool = {}
        for name, first in rows[0].items():
            values = [each[name] for each in rows]
            if name in self._own or name not in self._fields or any(not np.array_equal(first, x) for x in values):
                self._pool[name] = torch.as_tensor(np.stack(values), dtype=torch.float32, device=self.device)
        with self.here():
            for name in self._pool.keys() & set(self._fields) - self._own.keys():
                wide = self._warp.array(np.stack([rows[0][name]] * self.count), dtype=getattr(self._model, name).dtype)
                setattr(self._model, name, wide)
                self._own[name] = self._warp.to_torch(wide)
        # A graph holds the addresses of the fields that it was captured with.
        self._graphs.clear()
        self.starts = len(starts)
        """Number of starts."""

    def begin(self, worlds: Tensor, rows: Tensor) -> None:
        """Begin episodes at rest in the worlds where `worlds` (N,) is True, from the starts of `rows` (N,)."""
        for name, field in self._own.items():
            _put(field, worlds, self._pool[name][rows].reshape(field.shape))
        _put(self["qpos"], worlds, self._pool[""][rows])
        _put(self["ctrl"], worlds, self._pool["ctrl"][rows])
        for name in ("qvel", "qacc_warmstart", "time"):
            _put(self[name], worlds, torch.zeros_like(self[name]))
        self.refresh()

    def targets(self) -> Tensor:
        """The joint targets that are sent now (N, A) [rad]."""
        return self["ctrl"][:, self._actuators]

    def base(self, rows: Tensor) -> Tensor:
        """T_world_base (N, 4, 4) of the starts of `rows` (N,)."""
        return self._pool["base"][rows]

    def advance(self, commands: Tensor) -> None:
        """Simulate a control period.

        Args:
            commands: Targets (K, N, A) [rad] that are sent one after the other.
        """
        self._sent[..., self._actuators] = commands
        self._do("period", self._steps)

    def _do(self, name: str, work: Callable[[], None]) -> None:
        """Do some work of Warp, on a GPU as a graph from the second time on."""
        with self.here():
            if name in self._graphs:
                self._warp.capture_launch(self._graphs[name])
                return
            # The first time without a graph, because kernels are compiled and loaded at their first launch.
            work()
            if self._stream is not None:
                with self._warp.ScopedCapture() as capture:
                    work()
                self._graphs[name] = capture.graph

    def _steps(self) -> None:
        for command, steps in zip(self._commands, self._ramp, strict=True):
            self._warp.copy(self._data.ctrl, command)
            for _ in range(steps):
                self._mjw.step(self._model, self._data)
        self._mjw.forward(self._model, self._data)

    @property
    def pieces(self) -> int:
        """K, the number of commands in a control period."""
        return len(self._ramp)

    def __getitem__(self, name: str) -> Tensor:
        """A field of the state of all worlds, which shares its memory."""
        found: Tensor = self._warp.to_torch(getattr(self._data, name))
        return found

    def contacts(self) -> tuple[Tensor, Tensor, Tensor]:
        """World (C,), geoms (C, 2), and force on the second geom in the world (C, 3) [N]; 0 without a contact."""
        with self.here():
            self._forces.zero_()
            self._mjw.contact_force(self._model, self._data, self._ids, True, self._forces)
            contact = self._data.contact
            names = (contact.worldid, contact.geom, contact.efc_address, self._forces, self._data.nacon)
            world, geoms, address, forces, count = (self._warp.to_torch(each) for each in names)
        real = (torch.arange(len(world), device=self.device) < count) & (address[:, 0] >= 0)
        none = torch.zeros_like(world)
        return torch.where(real, world, none).long(), geoms.clamp(min=0).long(), forces[:, :3] * real[:, None]

    def check_room(self) -> None:
        """Compare what happened since the last call with the capacity; it copies to the host.

        Raises:
            RuleError: Worlds had more contacts or constraints than there is room for.
        """
        contacts, rows = int(self["nacon"][0]), int(self["nefc"].max())
        if contacts > self._data.naconmax or rows > CONSTRAINTS:
            raise RuleError(
                "worlds have more contacts or constraints than there is room for",
                code="DXB-B223",
                facts={
                    "contacts": f"{contacts}, room for {self._data.naconmax}",
                    "rows of constraints of one world": f"{rows}, room for {CONSTRAINTS}",
                },
                hint="make a task without so many things in contact",
            )

    @property
    def state(self) -> dict[str, Tensor]:
        """What the further motion depends on beside the model; tensors that share the memory."""
        names = ("qpos", "qvel", "ctrl", "qacc_warmstart", "time")
        return {name: self[name] for name in names} | {f"model.{name}": field for name, field in self._own.items()}

    def put(self, state: Mapping[str, Tensor]) -> None:
        """Set the state to one that `tensors` listed."""
        for name, tensor in self.state.items():
            tensor.copy_(state[f".physics.{name}"])

    def refresh(self) -> None:
        """Compute what depends on a state that was `put`."""
        self._do("forward", lambda: self._mjw.forward(self._model, self._data))


def _kept(value: np.ndarray, rows: Sequence[Mapping[str, np.ndarray]], name: str) -> np.ndarray:
    """A copy of a field of a model, or that of the first row, because most fields are the same in all."""
    return rows[0][name] if rows and np.array_equal(value, rows[0][name]) else np.array(value)


def _put(field: Tensor, worlds: Tensor, value: Tensor) -> None:
    field.copy_(torch.where(worlds.reshape(-1, *[1] * (field.ndim - 1)), value.to(field.dtype), field))
