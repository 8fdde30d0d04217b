"""Hand-eye calibrations: pose of a camera relative to a robot, its uncertainty and evidence; easy_handeye's YAML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import yaml
from pydantic import PositiveFloat, PositiveInt, ValidationError, model_validator

from dextera_build.artifacts import camera_files, camera_info, easy_handeye, lens
from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.formats import suffix_among, unreadable
from dextera_build.artifacts.frames import Frames
from dextera_build.artifacts.image import png
from dextera_build.artifacts.lens import BrownConrady, KannalaBrandt
from dextera_build.artifacts.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.geometry.plot import COLOURS, Line, plot

_SERIES = ("residuals", "leave_one_out", "reprojection_px")
_KINDS = ("chessboard", "charuco", "aruco", "apriltag")


class Board(Value):
    """The calibration board."""

    kind: Literal["chessboard", "charuco", "aruco", "apriltag"]
    """Pattern; `aruco` and `apriltag` are single markers or grids of them."""
    columns: PositiveInt = 1
    """Inner corners of a chessboard, squares of a ChArUco board, or markers, along x."""
    rows: PositiveInt = 1
    """The same along y."""
    square_m: PositiveFloat
    """Side of a square, or of a single marker, or of a marker and one gap in a grid of markers [m]."""
    marker_m: float = 0.0
    """Side of the markers of a ChArUco board, or of a grid, whose `square_m` is a marker with a gap [m]; 0 for a
    single marker, whose side is `square_m`."""
    dictionary: str = ""
    """Family of the markers: `DICT_5X5_100`, `36h11`."""


class Calibration(Artifact):
    """A hand-eye calibration: pose of a camera, its intrinsics, and the evidence for both."""

    saves: ClassVar[tuple[str, ...]] = (".yaml",)

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
        for name in _SERIES:
            series = getattr(self, name)
            if series is not None and (series < 0).any():
                raise ArtifactError(f"Calibration.{name}: a distance is below 0", code="DXB-A515")
        return self

    def observations(self) -> int:
        """Number of observations with at least one of these."""
        return next((len(series) for name in _SERIES if (series := getattr(self, name)) is not None), 0)

    def sigma(self) -> tuple[float, float] | None:
        """Standard deviation of the position [m] and of the rotation [rad], over all axes; None if not stated."""
        if self.pose.covariance is None:
            return None
        spread = np.diag(self.pose.covariance)
        return float(np.sqrt(spread[:3].sum())), float(np.sqrt(spread[3:].sum()))

    def facts(self) -> Iterator[str]:
        """Mount, frames, method, uncertainty and residuals."""
        yield self.mount
        yield f"T_{self.pose.parent}_{self.pose.child}"
        if self.method:
            yield self.method
        sigma = self.sigma()
        if sigma is not None:
            yield f"sigma {1000 * sigma[0]:.2g} mm, {np.degrees(sigma[1]):.2g} deg"
        if self.residuals is not None and len(self.residuals):
            distance, angle = np.sqrt((self.residuals**2).mean(axis=0))
            yield f"{len(self.residuals)} observations"
            yield f"residuals {1000 * distance:.2g} mm, {np.degrees(angle):.2g} deg RMS"

    def picture(self) -> bytes:
        """Residuals in blue and leave-one-out changes in orange, per observation: [mm] left, [deg] right."""
        drawn = [(self.residuals, COLOURS[0]), (self.leave_one_out, COLOURS[1])]
        sides = []
        for column, scale, unit in ((0, 1000.0, "[mm]"), (1, 180 / np.pi, "[deg]")):
            lines = [Line(np.zeros((1, 2)), (255, 255, 255), dots=True)]  # both axes begin at 0
            for series, colour in drawn:
                if series is not None:
                    values = np.stack([np.arange(1, len(series) + 1), scale * series[:, column]], axis=1)
                    lines.append(Line(values, colour, dots=True))
            sides.append(plot(lines, "observation", unit))
        return png(np.hstack(sides))

    def yaml(self) -> str:
        """easy_handeye's YAML, with additional fields that easy_handeye ignores."""
        more: dict[str, Any] = {"calibration_method": self.method} if self.method else {}
        if self.pose.covariance is not None:
            more["covariance"] = self.pose.covariance.tolist()
        if self.pose.stamp is not None:
            more["stamp"] = self.pose.stamp
        if self.board is not None:
            more["board"] = self.board.model_dump()
        if self.board_pose is not None:
            spread = self.board_pose.covariance
            more["board_pose"] = {
                "matrix": self.board_pose.matrix.tolist(),
                "covariance": None if spread is None else spread.tolist(),
            }
        more |= {name: getattr(self, name).tolist() for name in _SERIES if getattr(self, name) is not None}
        if self.camera is not None:
            more["camera_info"] = yaml.safe_load(camera_info.written(self.camera.intrinsics(), self.pose.child))
        frames = {"base": self.base_frame, "effector": self.effector_frame, "board": self.board_frame}
        frames["camera"] = self.pose.child
        return easy_handeye.written(easy_handeye.HandEye(self.mount == "eye_in_hand", frames, self.pose.matrix, more))

    def _write(self, path: Path) -> list[Path]:
        path.write_text(self.yaml())
        if self.camera is None:
            return [path]
        return [path, *camera_files.save(self.camera.intrinsics(), path.with_name(f"{path.stem}.camera_info.yaml"))]

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a file of easy_handeye or easy_handeye2, with intrinsics from `STEM.camera_info.yaml` if missing.

        Raises:
            ArtifactError: It is no such file.
        """
        path = Path(path)
        suffix_among(cls.name(), path, (".yaml", ".yml", ".calib"))
        beside = path.with_name(f"{path.stem}.camera_info.yaml")
        return cls.parse(path.read_bytes(), path, beside.read_bytes() if beside.is_file() else None)

    @classmethod
    def parse(cls, data: bytes, path: str | Path, intrinsics: bytes | None = None) -> Calibration:
        """The calibration in the content of a file that is named `path`.

        Args:
            data: The content.
            path: The file, for messages.
            intrinsics: A ROS camera_info, for a file without intrinsics.

        Raises:
            ArtifactError: One of them is damaged.
        """
        try:
            fields = _fields(easy_handeye.read(data.decode()))
        except ValueError as error:
            raise unreadable(path, "easy_handeye YAML", error) from None
        if fields["camera"] is None and intrinsics is not None:
            fields["camera"] = lens.of(camera_files.parse(intrinsics, Path("camera_info.yaml")))
        return cls(**fields)


def _fields(found: easy_handeye.HandEye) -> dict[str, Any]:
    frames, more = found.frames, found.more
    holder, other = ("effector", "base") if found.in_hand else ("base", "effector")
    known = more.get("camera_info")
    board_pose = more.get("board_pose")
    series = {name: _series(more, name) for name in _SERIES}
    stamp = more.get("stamp")
    pose = Pose(
        parent=frames[holder],
        child=frames["camera"],
        matrix=found.pose,
        covariance=_square(more.get("covariance"), "covariance", 6),
        stamp=camera_info.numbers([stamp], "stamp", 1)[0] if stamp is not None else None,
    )
    return {
        "mount": "eye_in_hand" if found.in_hand else "eye_on_base",
        "pose": pose,
        "base_frame": frames["base"],
        "effector_frame": frames["effector"],
        "board_frame": frames["board"],
        "camera": lens.of(camera_info.of(known)) if isinstance(known, Mapping) else None,
        "method": str(more.get("calibration_method", "")),
        "board": _board(more.get("board")),
        "board_pose": _pose(board_pose, frames[other], frames["board"]) if isinstance(board_pose, Mapping) else None,
        **series,
    }


def _series(more: Mapping[str, Any], name: str) -> np.ndarray | None:
    value = more.get(name)
    if value is None:
        return None
    numbers = np.array(camera_info.numbers(value, name))
    if name == "reprojection_px":
        return numbers
    if len(numbers) % 2:
        raise ValueError(f"its {name} are not pairs of a distance and an angle")
    return numbers.reshape(-1, 2)


def _square(value: object, name: str, size: int) -> np.ndarray | None:
    return None if value is None else np.array(camera_info.numbers(value, name, size * size)).reshape(size, size)


def _pose(fields: Mapping[str, Any], parent: str, child: str) -> Pose:
    matrix = _square(fields.get("matrix", ()), "board_pose.matrix", 4)
    return Pose(
        parent=parent, child=child, matrix=matrix, covariance=_square(fields.get("covariance"), "covariance", 6)
    )


def _board(value: object) -> Board | None:
    if value is None:
        return None
    if not isinstance(value, Mapping) or value.get("kind") not in _KINDS:
        raise ValueError(f"the kind of its board is not one of {', '.join(_KINDS)}")
    try:
        return Board(**{str(name): each for name, each in value.items()})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"its board: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
