"""Primitive `handover`: one hand takes an object from the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import model_validator

from dextera_build.errors import listing
from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal, UnfitError
from dextera_build.sim.primitives.stages import DONE, FAR_M, HOLD, MOVE, REACH, near
from dextera_build.sim.primitives.state import TaskState

WAITS, GIVEN, SHARED, TAKEN = range(4)
"""Stages: on its support; held by the giver alone; held by both hands; held by the receiver alone."""


class HandoverGoal(TypedGoal):
    """One hand takes the object from the other."""

    primitive: str = "handover"
    names: tuple[str, ...] = ()
    giver: str
    """Limb that holds it first."""
    receiver: str
    """Limb that holds it at the end."""

    @model_validator(mode="before")
    @classmethod
    def _named(cls, fields: Any) -> Any:
        return {"names": (f"receiver_is_{fields['receiver']}",), **fields}

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """1: the receiver is part of the name."""
        return (1.0,)


class Options(base.Options):
    """Options of a handover; with two hands, one name implies the other."""

    giver: str = ""
    """Limb that picks up the object."""
    receiver: str = ""
    """Limb that holds it at the end."""

    @model_validator(mode="after")
    def _of_two(self) -> Options:
        if self.giver and self.giver == self.receiver:
            raise ValueError(f"`giver` and `receiver` are both `{self.giver}`; name two limbs, or one of them")
        return self

    def goal(self, setting: Setting) -> HandoverGoal:
        """The two limbs."""
        limbs = setting.robot.limb_names
        given = [name for name in (self.giver, self.receiver) if name]
        unknown = [name for name in given if name not in limbs]
        if unknown:
            raise base.no_limb(unknown[0], setting.robot)
        rest = [name for name in limbs if name not in given]
        if not given or (len(given) == 1 and len(rest) != 1):
            raise UnfitError("a handover names its hands", hint=f"set `giver: {limbs[0]}`", limbs=listing(limbs))
        return HandoverGoal(giver=self.giver or rest[0], receiver=self.receiver or rest[0])


class Primitive(base.Primitive[HandoverGoal]):
    """The receiver alone holds the object after the giver held it, then both, and it touched nothing in between.

    After a throw, a drop, or setting the object down, the sequence starts again.
    """

    goal_type = HandoverGoal
    shaped = False
    hands = 2
    stages = ("touched", "given", "in both hands", "taken")

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the receiver took the object and holds it alone."""
        return np.asarray((past.stage == TAKEN) & now.grasp((self.goal.receiver,)).alone)

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """The stage; an object on a support, or in no hand, is in the first stage."""
        fault = base.faulted(past.fault, {"the object jumped": base.jumped(past.before, now)})
        given, taken = (now.hand(limb).presses for limb in self.ordered())
        before = past.stage
        # The first case that applies counts.
        cases = {
            WAITS: now.supported | ~now.touched(),
            GIVEN: now.grasp((self.goal.giver,)).alone,
            SHARED: ((before == GIVEN) | (before == SHARED)) & given & taken,
            TAKEN: ((before == SHARED) | (before == TAKEN)) & now.grasp((self.goal.receiver,)).alone,
        }
        stage = np.select(list(cases.values()), list(cases), np.where((before == TAKEN) & given, SHARED, before))
        return Past(now, stage, fault, past.mark)

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Touched by a hand, then the stages of `Past`."""
        return base.furthest(now.touched(), *(past.stage == stage for stage in (GIVEN, SHARED, TAKEN)))

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The stage that was not reached."""
        reasons = {
            WAITS: "the giver does not hold the object",
            GIVEN: "the receiver does not hold the object",
            SHARED: "the giver did not let go",
            TAKEN: "the receiver does not hold the object",
        }
        return np.asarray(np.array(list(reasons.values()))[past.stage])

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """Value of the stages: lifted by the giver, then reached and held by the receiver, then by it alone."""
        giver, receiver = (now.hand(limb) for limb in self.ordered())
        found = REACH * near(reach_m) + 0.5 * HOLD * np.minimum(giver.fingers, 2) / 2
        # At most as much as in both hands; the receiver may come from anywhere, so that its share has no lower end.
        coming = 0.3 * (1.0 - np.fmin(reach_m, FAR_M) / FAR_M) + 0.15 * receiver.presses
        given = REACH + HOLD + MOVE * coming
        taken = REACH + HOLD + MOVE * np.where(giver.presses, 0.5, 1.0) + DONE * success
        held = np.where(receiver.held, taken, np.where(giver.held, given, found))
        return np.where(now.supported, found, held)

    def reaching(self, now: TaskState) -> np.ndarray:
        """The giver, and the receiver once the giver holds the object off its support."""
        giver, receiver = self.ordered()
        return np.where(now.hand(giver).held & ~now.supported, receiver, giver)

    def ordered(self) -> tuple[str, ...]:
        """Giver and receiver."""
        return self.goal.giver, self.goal.receiver
