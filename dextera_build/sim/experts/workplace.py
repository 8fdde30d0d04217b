"""Whether a recording of hands was made with a task and its robot.

Takes begin at starts of the task, and their operator moved the hands as the robot in the picture answered. So another
task is refused, and so is another robot, unless somebody says that retargeting to it is meant. What is not known is not
refused. If task and robot are the same and the model is another one, as after a new calibration, a take may end
otherwise, which is a warning.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal

from dextera_build import digest
from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.hand_stream import HandStream, Workplace
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing

Other = Literal["task", "robot"]
"""What may be another one than that of the recording."""


def of(bundle: TaskBundle, limits: Limits | None = None) -> Workplace:
    """The workplace of an operator who does a task with a robot whose guard enforces `limits`."""
    joints = tuple(joint.name for joint in bundle.robot.joints)
    model = digest.of_bytes(bundle.model.files.get("scene.xml", b""))
    return Workplace(
        task=bundle.task.name, robot=bundle.robot.model_name, joints=joints, model=model, limits=limits or Limits()
    )


def check(recording: HandStream, bundle: TaskBundle, accepted: Collection[Other] = ()) -> str:
    """Refuse a recording that was made with another task or another robot.

    Args:
        recording: The hands.
        bundle: The task that they are to do.
        accepted: What may be another one.

    Returns:
        What else differs, so that takes may end otherwise than their operator saw; empty: nothing that is known.

    Raises:
        RuleError: Task or robot is another one, and is not accepted.
    """
    there, here = recording.workplace, of(bundle)
    if there is None:
        return ""
    others: dict[Other, bool] = {"task": there.task != here.task, "robot": there.joints != here.joints}
    refused: list[Other] = [what for what, other in others.items() if other and what not in accepted]
    if refused:
        meant = ", ".join(what for what, other in others.items() if other)
        raise RuleError(
            f"the hands were recorded with another {' and another '.join(refused)}",
            code="DXB-B533",
            facts={
                "recorded": f"{there.task} with {there.robot}, {len(there.joints)} joints",
                "to be done": f"{here.task} with {here.robot}, {len(here.joints)} joints",
                "joints of one alone": listing(sorted({*there.joints} ^ {*here.joints}), most=6) or "none",
            },
            hint=f"give the task of the recording, or `accept_other: [{meant}]` if these hands are meant for it",
        )
    if any(others.values()):
        return f"the hands were recorded in {there.task} with {there.robot}: their operator saw something else"
    if there.model and there.model != here.model:
        return "the task's model is another one than when the hands were recorded: takes may end otherwise"
    return ""
