"""Record one episode at control rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.episode import Episode, Origin, Segment
from dextera_build.artifacts.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment


class Recorder:
    """Collects the rows of one episode.

    Call `before(action, hand)` with the next command, step the environment, then `after(executed)`.

    Args:
        environment: An environment at the start of its episode.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._rows: dict[str, list[np.ndarray]] = {
            name: [] for name in ("action", "executed", "joints", "hand", "objects", "displacement", "contact")
        }

    def __len__(self) -> int:
        return len(self._rows["executed"])

    def before(self, action: np.ndarray, hand: np.ndarray | None = None) -> None:
        """Record the observation, the action (A,) [rad] taken on it, and its palm poses (L, 7) in the base."""
        environment, rows = self._environment, self._rows
        measured = environment.measure()
        rows["action"].append(np.asarray(action, np.float32))
        rows["joints"].append(measured.joints)
        rows["hand"].append(environment.palm_poses() if hand is None else hand)
        rows["objects"].append(measured.objects)
        rows["displacement"].append(measured.displacement)
        rows["contact"].append(environment.contact_forces())

    def after(self, executed: np.ndarray) -> None:
        """Record the executed command."""
        self._rows["executed"].append(np.asarray(executed))

    def episode(self, origin: Origin, *, success: bool, reason: str = "", segments: Sequence[Segment] = ()) -> Episode:
        """The episode so far. A non-finite action is stored as 0; the reason reports it."""
        bundle = self._environment.bundle
        rows = {
            name: np.nan_to_num(np.array(values, np.float32).reshape(len(self), *_shape(name, bundle)))
            for name, values in ((name, values[: len(self)]) for name, values in self._rows.items())
        }
        return Episode(
            start=self._environment.start,
            origin=origin,
            success=success,
            reason=reason,
            segments=tuple(segments),
            goal=self._environment.goal,
            **rows,
        )


def _shape(name: str, bundle: TaskBundle) -> tuple[int, ...]:
    joints = len(bundle.robot.joints)
    return {
        "action": (joints,),
        "executed": (joints,),
        "joints": (joints,),
        "hand": (len(bundle.robot.limbs), 7),
        "objects": (len(bundle.objects), 7),
        "displacement": (len(bundle.displacement_names),),
        "contact": (len(bundle.robot.tips), 3),
    }[name]
