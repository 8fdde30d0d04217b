"""Hands of an operator over time: 25 joints of each, the head, pinch, clutch and buttons; `formats.hand_stream`."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.spatial import stamped
from dextera_build.errors import ArtifactError
from dextera_build.geometry.hands import JOINTS, SIDES, WRIST

LOST, PREDICTED, TRACKED = 0, 1, 2
"""Codes of `HandStream.tracking`: no pose; extrapolated without a measurement; measured."""
_UNIT = 1e-3
"""Largest difference of a quaternion's length from 1 in single precision and as devices round it."""


class Take(Value):
    """One demonstration within a recording: messages `first` to `last` - 1."""

    first: NonNegativeInt
    """First message."""
    last: PositiveInt
    """One past the last message."""
    seed: int | None = None
    """Seed of the start that the operator saw; None: not known."""
    finger_lengths_m: tuple[tuple[float, ...] | None, tuple[float, ...] | None] = (None, None)
    """Lengths of the five fingers of the left and the right hand that were measured before the take,
    `geometry.hands.finger_lengths` [m]; None: not measured, so that medians over the take serve."""


class Workplace(Value):
    """What an operator saw and moved when the hands were recorded."""

    task: str = Field(min_length=1)
    """Name of the task."""
    robot: str
    """Name of the robot."""
    joints: tuple[str, ...]
    """Actuated joints of the robot, in order."""
    model: str = ""
    """Digest of the task's model, see `sim.experts.workplace`; empty: not known."""
    limits: Limits = Limits()
    """Limits that the guard enforced on the robot."""


class HandStream(Artifact):
    """Both hands of an operator, message by message, in one frame with z up."""

    frame: str = Field(pattern=r"^\S+$")
    """Frame that all poses are in; its z axis points up."""
    device: str = Field(min_length=1)
    """What recorded it: headset, webcam, or the program that made it."""
    synthetic: bool
    """Whether a program made the motion: no person and no headset took part."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times, increasing; files hold them as whole nanoseconds."""
    positions: Annotated[np.ndarray, Array("N 2 25 3", "float32", unit="m", frame="frame", finite=False)]
    """Joints of the left and the right hand in WebXR's order (`geometry.hands.JOINTS`); NaN where a hand is lost."""
    rotations: Annotated[np.ndarray, Array("N 2 25 4", "float32", frame="frame", finite=False)]
    """Unit quaternions w x y z of the joints, with WebXR's axes (`geometry.hands`); NaN where a hand is lost."""
    tracking: Annotated[np.ndarray, Array("N 2", "uint8")]
    """Per hand: 0 lost, 1 predicted without a measurement, 2 tracked."""
    head: Annotated[np.ndarray, Array("N 7", "float32", unit="m", frame="frame", finite=False)] | None = None
    """Head: position, and unit quaternion w x y z with -Z ahead and +Y up; NaN where it is lost. None: no head was
    recorded, as by a webcam."""
    pinch: Annotated[np.ndarray, Array("N 2", "float32")]
    """Pinch of thumb and index finger per hand, 0 (open) to 1 (closed)."""
    clutch: Annotated[np.ndarray, Array("N 2", "bool")]
    """Whether a hand moves the robot; otherwise the operator only changes posture."""
    button_names: tuple[str, ...] = ()
    """Further inputs, in the order of the columns of `buttons`."""
    buttons: Annotated[np.ndarray, Array("N B", "float32")] | None = None
    """Values of further inputs, 0 to 1; None if there are none."""
    workplace: Workplace | None = None
    """The task and the robot that the hands were recorded with; None: not known, as of other recorders."""
    takes: tuple[Take, ...] = ()
    """Demonstrations in the recording, in order; none: all messages are one."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.stamps):
            raise ArtifactError("a HandStream needs a message", code="DXB-A550")
        stamped.check_stamps(self.name(), self.stamps)
        self._check_hands()
        self._check_inputs()
        ends = [edge for take in self.takes for edge in (take.first, take.last)]
        if (
            ends != sorted(ends)
            or any(take.first >= take.last for take in self.takes)
            or ends[-1:] > [len(self.stamps)]
        ):
            raise ArtifactError(
                "HandStream: its takes overlap, are empty, or reach beyond the messages",
                code="DXB-A551",
                facts={"takes": ", ".join(f"{take.first} to {take.last}" for take in self.takes)}
                | {"messages": len(self.stamps)},
                hint="list takes in order; `last` is one past the last message",
            )
        return self

    def _check_hands(self) -> None:
        if self.tracking.max() > TRACKED:
            raise ArtifactError(
                f"HandStream.tracking: there is no state {self.tracking.max()}",
                code="DXB-A552",
                facts={"states": "0 lost, 1 predicted, 2 tracked"},
            )
        poses = np.concatenate([self.positions, self.rotations], axis=-1)
        known, unknown = np.isfinite(poses).all(axis=(2, 3)), np.isnan(poses).all(axis=(2, 3))
        wrong = np.argwhere(np.where(self.tracking > LOST, ~known, ~unknown))
        if len(wrong):
            row, hand = wrong[0]
            joints = int((~np.isfinite(poses[row, hand])).any(axis=-1).sum())
            raise ArtifactError(
                f"HandStream: the {SIDES[hand]} hand at {self.stamps[row]} s does not fit its tracking state "
                f"{self.tracking[row, hand]}",
                code="DXB-A553",
                facts={"joints without a number": f"{joints} of {len(JOINTS)}", "hands": len(wrong)},
                hint="a lost hand (0) is NaN throughout, and any other is finite",
            )
        heads = np.zeros((0, 4), np.float32) if self.head is None else self.head[:, 3:]
        for what, turns in (("rotations", self.rotations.reshape(-1, 4)), ("head", heads)):
            length = np.linalg.norm(turns, axis=1)
            bad = np.flatnonzero(np.abs(length - 1) > _UNIT)  # NaN compares as false
            if len(bad):
                raise ArtifactError(
                    f"HandStream.{what}: {len(bad):,} of {len(turns):,} quaternions are of another length than 1",
                    code="DXB-A554",
                    facts={"first length": f"{length[bad[0]]:.6g}"},
                    hint="divide each by its length; the order is w x y z"
                    if length[bad[0]] > 0
                    else "record rotations, too, or 1 0 0 0 where the device has none",
                )

    def _check_inputs(self) -> None:
        if not ((self.pinch >= 0) & (self.pinch <= 1)).all():
            raise ArtifactError(
                "HandStream.pinch is outside of 0 (open) to 1 (closed)",
                code="DXB-A555",
                facts={"found": f"{self.pinch.min():.4g} to {self.pinch.max():.4g}"},
            )
        columns = 0 if self.buttons is None else self.buttons.shape[1]
        if columns != len(self.button_names):
            raise ArtifactError(
                f"HandStream: {len(self.button_names)} names for {columns} columns of buttons", code="DXB-A556"
            )

    def during(self, take: Take) -> HandStream:
        """The messages of one take as a stream of its own, with their times."""
        rows = slice(take.first, take.last)
        names = ("stamps", "positions", "rotations", "tracking", "head", "pinch", "clutch", "buttons")
        parts = {name: getattr(self, name) for name in names}
        cut = {name: None if part is None else part[rows] for name, part in parts.items()}
        whole = take.model_copy(update={"first": 0, "last": take.last - take.first})
        return self.model_copy(update={**cut, "takes": (whole,)})

    @property
    def demonstrations(self) -> tuple[Take, ...]:
        """The takes; one of all messages if none are marked."""
        return self.takes or (Take(first=0, last=len(self.stamps)),)

    @property
    def known_heads(self) -> np.ndarray:
        """Rows (K, 7) of `head` that are not lost; none without a head."""
        return np.zeros((0, 7), np.float32) if self.head is None else self.head[np.isfinite(self.head).all(axis=1)]

    @property
    def wrists(self) -> np.ndarray:
        """Poses (N, 2, 7) of the wrists in `frame`: position [m] and quaternion w x y z; NaN where a hand is lost."""
        return np.concatenate([self.positions[:, :, WRIST], self.rotations[:, :, WRIST]], axis=-1)

    @property
    def rate_hz(self) -> float:
        """Usual rate of the messages: one over the median of the times between them [Hz]; 0 for a single message."""
        return float(1 / np.median(np.diff(self.stamps))) if len(self.stamps) > 1 else 0.0
