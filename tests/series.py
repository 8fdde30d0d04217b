"""Hand-made trials: how many succeeded is given, nothing is simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskSpec, WorldKind
from dextera_build.artifacts.tasks.trials import Trial, Trials
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal

STAGES = ("moved", "halfway", "at its command", "success")
"""Steps of the tasks; failures of `trials` end halfway."""


def task(name: str = "CloseLaptop", **changed: float) -> TaskSpec:
    """A task of that name."""
    tolerance = changed.pop("tolerance", 0.0)
    return TaskSpec(
        name=name, object="laptop", goal=ArticulateGoal(joints={"hinge": 0.0}, tolerance=tolerance), **changed
    )


def trials(
    verdicts: Sequence[bool] | tuple[int, int],
    label: str = "ACT",
    world: WorldKind = "twin",
    *,
    name: str = "CloseLaptop",
    robot: str = "kuka_leap",
    seeds: Sequence[int] | None = None,
    **changed: object,
) -> Trials:
    """Trials with given verdicts, or (successes, trials).

    Args:
        verdicts: One per trial, or how many of how many succeed.
        label: What tables call the actor; `replay` makes it one.
        world: Kind of world.
        name: Name of the task.
        robot: Name of the robot's model.
        seeds: Of the starts; by default 0, 1, 2, ...
        changed: Other fields.
    """
    if isinstance(verdicts, tuple) and not isinstance(verdicts[0], bool):
        verdicts = [number < verdicts[0] for number in range(verdicts[1])]
    known = list(seeds) if seeds is not None else list(range(len(verdicts)))
    items = [
        Trial(
            seed=seed,
            start=f"{seed}",
            success=bool(done),
            reason="" if done else "slipped",
            steps=40 + 2 * number,
            stage=len(STAGES) if done else 2,
        )
        for number, (seed, done) in enumerate(zip(known, verdicts, strict=True))
    ]
    fields = {
        "actor": "replay" if label == "replay" else "policy",
        "label": label,
        "algorithm": "" if label == "replay" else label.split()[0].lower(),
        "source": "0" * 64,
        "task": task(name),
        "embodiment": f"{robot:0>64}",
        "robot": robot,
        "world": world,
        "stages": STAGES,
        "items": tuple(items),
        "placed": placed(known),
        "excluded": {},
        "examples": none(),
    }
    return Trials(**(fields | changed))


def placed(seeds: Sequence[int]) -> np.ndarray:
    """Poses (N, 1, 7) of one object, drawn by seed."""
    rows = [np.append(np.random.default_rng(seed).uniform(-0.1, 0.1, 3), [1.0, 0, 0, 0]) for seed in seeds]
    return np.array(rows, np.float32).reshape(len(seeds), 1, 7)


def none() -> Episodes:
    """No episode."""
    return Episodes(
        items={},
        failures={},
        attempts=0,
        task="CloseLaptop",
        embodiment="0" * 64,
        rate_hz=20.0,
        joint_names=("joint",),
        object_names=("laptop",),
        displacement_names=("hinge",),
        tip_names=(),
        limb_names=(),
    )
