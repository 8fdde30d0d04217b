"""A calibration capture: pictures of a robot at rest in several poses, with the state of the robot."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import ArtifactError


class RobotViews(Artifact):
    """Pictures of a robot at rest in several poses, with its joint positions or its effector's poses in each.

    Rows of all arrays are in the order of `captures`, sorted by name as in every stored mapping, so that `rgb_10`
    precedes `rgb_9`. Input in another order is sorted, together with its rows.
    """

    captures: dict[str, Capture] = Field(min_length=1)
    """Name of a picture -> the picture, with depth if measured."""
    mount: Literal["eye_on_base", "eye_in_hand"]
    """As in `Calibration`: a camera next to the robot, or on its hand."""
    joints: Joints | None = None
    """Joint positions at the times of the pictures, (K, J); None: only the effector's poses are known."""
    effectors: Annotated[np.ndarray, Array("K 7", "float64", unit="m", frame="base")] | None = None
    """T_base_effector from the robot's controller: position, and unit quaternion w x y z."""
    effector_frame: str = "effector"
    """Part of the robot whose poses are in `effectors`: a link or frame of its model."""
    board: Board | None = None
    """The board on the effector, or in front of the camera on it; None: no board."""
    skew_s: Annotated[np.ndarray, Array("K", "float64", unit="s")] | None = None
    """Time from each picture to the nearest joint measurement; None: not a recording over time."""

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, fields: Any) -> Any:
        captures = fields.get("captures") if isinstance(fields, dict) else None
        if not isinstance(captures, dict) or list(captures) == sorted(captures):
            return fields
        names = list(captures)
        order = sorted(range(len(names)), key=lambda number: names[number])
        changed: dict[str, Any] = {"captures": {names[number]: captures[names[number]] for number in order}}
        for name in ("effectors", "skew_s"):
            rows = fields.get(name)
            if isinstance(rows, np.ndarray) and len(rows) == len(order):
                changed[name] = rows[order]
        joints = fields.get("joints")
        if isinstance(joints, Joints) and len(joints.positions) == len(order):
            rows = {name: getattr(joints, name) for name in ("stamps", "positions", "velocities", "efforts")}
            moved = {name: each[order] for name, each in rows.items() if each is not None}
            changed["joints"] = joints.model_copy(update=moved)
        return {**fields, **changed}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.joints is None and self.effectors is None:
            raise ArtifactError(
                "RobotViews: neither joint positions nor poses of the effector are known",
                code="DXB-A527",
                hint="record `/joint_states`, or write the controller's T_base_ee with each picture",
            )
        count = len(self.captures)
        rows = {
            "joints": None if self.joints is None else len(self.joints.positions),
            "effectors": None if self.effectors is None else len(self.effectors),
            "skew_s": None if self.skew_s is None else len(self.skew_s),
        }
        for name, length in rows.items():
            if length not in (None, count):
                raise ArtifactError(
                    f"RobotViews.{name}: {length} rows for {count} pictures",
                    code="DXB-A528",
                    hint="give one row per picture, in the order of the pictures",
                )
        return self
