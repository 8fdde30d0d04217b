"""Hand-eye calibrations: pose of a camera relative to a robot, its uncertainty and evidence; easy_handeye's YAML."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import PositiveFloat, PositiveInt, model_validator

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, KannalaBrandt
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError

SERIES = ("residuals", "leave_one_out", "reprojection_px")


class Board(Value):
    """The calibration board."""

    kind: Literal["chessboard", "charuco", "aruco", "apriltag", "circles", "asymmetric_circles"]
    """Pattern; `aruco` and `apriltag` are single markers or grids of them."""
    columns: PositiveInt = 1
    """Inner corners of a chessboard, squares of a ChArUco board, markers, or circles of one row, along x."""
    rows: PositiveInt = 1
    """The same along y."""
    square_m: PositiveFloat
    """Side of a square, or of a single marker, or of a marker and one gap in a grid of markers; distance of
    the centres of neighbouring circles, or of neighbouring rows if they are asymmetric [m]."""
    marker_m: float = 0.0
    """Side of the markers of a ChArUco board, or of a grid, whose `square_m` is a marker with a gap [m]; 0 for a
    single marker, whose side is `square_m`."""
    dictionary: str = ""
    """Family of the markers: `DICT_5X5_100`, `36h11`."""


class Calibration(Artifact):
    """A hand-eye calibration: pose of a camera, its intrinsics, and the evidence for both."""

    mount: Literal["eye_on_base", "eye_in_hand"]
    """`eye_on_base`: the camera watches the robot from a fixed position; `eye_in_hand`: it is on the hand."""
    pose: Annotated[Pose, Frames(None, None)]
    """T_base_camera for `eye_on_base`, T_effector_camera for `eye_in_hand`; with its covariance if known."""
    base_frame: str = "base"
    """The robot's base."""
    effector_frame: str = "effector"
    """The part of the robot whose poses were recorded."""
    board_frame: str = "board"
    """The board."""
    camera: Camera | BrownConrady | KannalaBrandt | None = None
    """Intrinsics; None: not stated."""
    method: str = ""
    """Method: `Park`, `Tsai, refined`."""
    board: Board | None = None
    """The board; None: not stated."""
    board_pose: Pose | None = None
    """T_effector_board for `eye_on_base`, T_base_board for `eye_in_hand`: the other unknown of the problem."""
    residuals: Annotated[np.ndarray, Array("K 2", "float64")] | None = None
    """Per observation: closing error of the chain of poses, translation [m] and rotation [rad]."""
    leave_one_out: Annotated[np.ndarray, Array("K 2", "float64")] | None = None
    """Per observation: change of `pose` without it, translation [m] and rotation [rad]."""
    reprojection_px: Annotated[np.ndarray, Array("K", "float64")] | None = None
    """Per observation: root mean square distance of the board's corners in the picture [px]."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        holder, other = self.base_frame, self.effector_frame
        if self.mount == "eye_in_hand":
            holder, other = other, holder
        wanted = [(self.pose, holder, self.pose.child), (self.board_pose, other, self.board_frame)]
        for pose, parent, child in wanted:
            if pose is not None and (pose.parent, pose.child) != (parent, child):
                raise ArtifactError(
                    f"Calibration: {self.mount} needs T_{parent}_{child}, but T_{pose.parent}_{pose.child} came",
                    code="DXB-A514",
                    hint="eye_on_base: T_base_camera, T_effector_board; eye_in_hand: T_effector_camera, T_base_board",
                )
        for name in SERIES:
            series = getattr(self, name)
            if series is not None and (series < 0).any():
                raise ArtifactError(f"Calibration.{name}: a distance is below 0", code="DXB-A515")
        return self

    def observations(self) -> int:
        """Number of observations with at least one of these."""
        return next((len(series) for name in SERIES if (series := getattr(self, name)) is not None), 0)
