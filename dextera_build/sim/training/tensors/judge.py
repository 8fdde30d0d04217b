"""Verdicts and values of many worlds, by the conditions of `sim.primitives`, on the device of their states."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.base import Past
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.training.tensors.cavity import in_cavity
from dextera_build.sim.training.tensors.cells import Words, cells, on_tensors


class TensorJudge:
    """Follows one episode in each of N worlds, as `sim.primitives.success.Judge` does.

    Args:
        task: The objective.
        start: States at the reset; their arrays are `Cells`.
        objects: Body -> object of the task's model.
    """

    def __init__(self, task: TaskSpec, start: TaskState, objects: Mapping[str, TaskObject] | None = None) -> None:
        self.primitive = catalogue.of(task, objects)
        into = getattr(self.primitive.goal, "into", None)
        if into:  # the one condition that is written for single worlds
            cavity, points = self.primitive.objects[into].cavity, self.primitive.objects[task.object].points
            assert cavity is not None
            placed: Any = self.primitive
            skin_m = sys.modules[type(placed).__module__].SKIN_M  # not imported: primitives are in no key but their own
            placed._inside = lambda pose, other: in_cavity(cavity, skin_m, points, pose, other)
        self.start, self._hold_s = start, task.hold_s
        self._past = _begun(start)
        self._held_at_reset = self._holds(start, self._past)
        self._never = torch.full_like(_tensor(start.time_s), np.inf).as_subclass(Tensor)
        self._since = self._never

    @property
    def state(self) -> Any:
        """What it knows of the episodes, for `chosen` and `tensors`."""
        return {"start": self.start, "past": self._past, "held": self._held_at_reset, "since": self._since}

    @state.setter
    def state(self, state: Any) -> None:
        self.start, self._past = state["start"], state["past"]
        self._held_at_reset, self._since = state["held"], state["since"]

    def begin(self, worlds: Tensor, now: TaskState) -> None:
        """Begin new episodes in the worlds where `worlds` (N,) is True, in their states `now`."""
        self.start = chosen(worlds, now, self.start)
        self._past = chosen(worlds, _begun(now), self._past)
        self._held_at_reset = self._holds(self.start, _begun(self.start))
        self._since = torch.where(worlds, self._never, self._since)

    def update(self, now: TaskState) -> Tensor:
        """Process one control period (N,); True once the condition has held for the task's `hold_s`."""
        with on_tensors(self.primitive):
            self._past = self.primitive.follow(self._past, self.start, now)
        held = self._holds(now, self._past) & (self._past.fault == "") & ~self._held_at_reset
        self._since = torch.where(held, torch.minimum(self._since, _tensor(now.time_s)), self._never)
        return (_tensor(now.time_s) - self._since >= self._hold_s - 1e-5).as_subclass(Tensor)

    def value(self, reach_m: Tensor, now: TaskState, success: Tensor) -> Tensor:
        """Values of states (N,), see `Primitive.value`."""
        with on_tensors(self.primitive):
            found: Any = self.primitive.value(cells(reach_m), self.start, now, cells(success))  # type: ignore[arg-type]
        return _tensor(found).as_subclass(Tensor)

    def aims(self, now: TaskState) -> tuple[Any, Any]:
        """Words (N,) of the limb or the joint that should be reached, None: any; and the way of a joint (N,)."""
        with on_tensors(self.primitive):
            pushed = self.primitive.pushed(self.start, now)
            return pushed if pushed is not None else (self.primitive.reaching(now), None)

    def _holds(self, now: TaskState, past: Past) -> Tensor:
        with on_tensors(self.primitive):
            return _tensor(self.primitive.holds(self.start, now, past))


def chosen(worlds: Tensor, one: Any, other: Any) -> Any:
    """States, or anything made of tensors: of `one` where `worlds` (N,) is True, of `other` in the other worlds."""
    if isinstance(one, Words):
        return Words(torch.where(worlds, one.codes, other.codes))
    if isinstance(one, Tensor):
        return torch.where(worlds.reshape(-1, *[1] * (one.ndim - 1)), one, other)
    if isinstance(one, Mapping):
        return {name: chosen(worlds, each, other[name]) for name, each in one.items()}
    if not is_dataclass(one):
        return one
    names = [each.name for each in fields(one) if each.init]
    made: Any = type(one)
    return made(*(chosen(worlds, getattr(one, name), getattr(other, name)) for name in names))


def tensors(state: Any, name: str = "") -> Iterator[tuple[str, Tensor]]:
    """The tensors of a state with their names, in order; they share its memory."""
    if isinstance(state, Words):
        yield name, state.codes
    elif isinstance(state, Tensor):
        yield name, state
    elif isinstance(state, Mapping):
        for key, each in state.items():
            yield from tensors(each, f"{name}.{key}")
    elif is_dataclass(state):
        for field in fields(state):
            if field.init:
                yield from tensors(getattr(state, field.name), f"{name}.{field.name}")


def filled(state: Any, values: Mapping[str, Tensor], name: str = "") -> Any:
    """A state like `state` with the tensors that `tensors` listed, each in memory of its own."""
    if isinstance(state, Words):
        return Words(values[name].to(state.codes.device))
    if isinstance(state, Tensor):
        return values[name].to(state.device).clone().as_subclass(type(state))
    if isinstance(state, Mapping):
        return {key: filled(each, values, f"{name}.{key}") for key, each in state.items()}
    if not is_dataclass(state):
        return state
    names = [each.name for each in fields(state) if each.init]
    made: Any = type(state)
    return made(*(filled(getattr(state, each), values, f"{name}.{each}") for each in names))


def _begun(start: TaskState) -> Past:
    count, device = len(start.time_s), _tensor(start.time_s).device
    zeros = torch.zeros(count, dtype=torch.int64, device=device)
    mark = cells(torch.full((count, 3), np.nan, device=device))
    return Past(start, cells(zeros), Words(zeros), mark)  # type: ignore[arg-type]


def _tensor(value: Any) -> Tensor:
    """A tensor that code for arrays gave."""
    assert isinstance(value, Tensor)
    return value
