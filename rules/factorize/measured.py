"""Measured depth for backends that make assets with its help: whoever takes it has the result labelled `rgbd`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from dextera_build.artifacts.camera import Camera, Measured, Photograph
from dextera_build.artifacts.image import Image
from dextera_build.artifacts.object import AssetSource, Support
from dextera_build.artifacts.view import MeasuredView, ObjectView, Seen
from dextera_build.geometry import upright
from dextera_build.rule import Context

T = TypeVar("T")


@dataclass(frozen=True)
class Workspace:
    """A photograph with the depth of the same pixels, in the world frame of its support."""

    photograph: Photograph
    depth: np.ndarray
    """(H, W) float32 image-plane z [m]; 0 where nothing was measured."""
    support: Support

    @property
    def pixels(self) -> np.ndarray:
        """(H, W, 3) uint8 sRGB."""
        return self.photograph.rgb.pixels

    @property
    def camera(self) -> Camera:
        """Intrinsics of photograph and depth."""
        return self.photograph.camera

    @property
    def world_from_camera(self) -> np.ndarray:
        """T_world_camera, (4, 4)."""
        return self.support.camera_pose.matrix

    @property
    def turns(self) -> int:
        """Counter-clockwise quarter turns that make the photograph upright."""
        return upright.turns(self.world_from_camera)

    def upright(self) -> Workspace:
        """The same scene as a camera held upright saw it: the photograph turned by `turns`, the same world."""
        if not self.turns:
            return self
        camera = self.camera.turned(self.turns)
        pose = self.support.camera_pose
        matrix = pose.matrix @ np.linalg.inv(upright.turned_from_camera(self.turns))
        return Workspace(
            Photograph(rgb=Image(pixels=upright.turned(self.pixels, self.turns)), camera=camera),
            upright.turned(self.depth, self.turns),
            self.support.model_copy(update={"camera_pose": pose.model_copy(update={"matrix": matrix})}),
        )


class Measurements(Generic[T]):
    """What was measured, handed to a backend that may or may not read it.

    Args:
        ctx: The rule's context.
        value: The measurements; None if there is nothing but the photograph.
        lacking: What is missing if there are none: `the capture has no depth`.
    """

    def __init__(self, ctx: Context, value: T | None, lacking: str) -> None:
        self._ctx = ctx
        self._value = value
        self._lacking = lacking
        self.taken = False
        """Whether the backend made its result with them."""

    def needed(self) -> T:
        """The measurements; from here on the result is labelled `rgbd`.

        Raises:
            RuleError: There are none, and this backend cannot do without.
        """
        self.taken = True
        if self._value is None:
            self._ctx.fail(
                f"this backend makes assets with the help of measured depth, but {self._lacking}",
                hint="add the depth to the capture, or choose a backend that works without it: `dxb ls backends`",
            )
        return self._value

    def for_check(self) -> T | None:
        """The measurements for a metric or a picture that leaves the result as it is, or None."""
        return self._value

    def source(self, *inputs: AssetSource) -> AssetSource:
        """The label of a result that was made from `inputs` and, if they were taken, from the measurements."""
        return "rgbd" if self.taken or "rgbd" in inputs else "rgb"


def of_workspace(
    ctx: Context, photograph: Photograph, measured: Measured | None, support: Support | None
) -> Measurements[Workspace]:
    """The measurements of a whole photograph.

    Raises:
        RuleError: Photograph and depth differ in size.
    """
    if measured is None:
        return Measurements(ctx, None, "the capture has no depth")
    if support is None:
        return Measurements(ctx, None, "the input `support` is not given")
    size, depth = photograph.rgb.pixels.shape[:2], measured.depth.depth
    if depth.shape != size:
        ctx.fail(
            "the depth is of another picture",
            photograph=f"{size[1]} x {size[0]} px",
            depth=f"{depth.shape[1]} x {depth.shape[0]} px",
            hint="take both from one capture",
        )
    return Measurements(ctx, Workspace(photograph, depth, support), "")


def of_view(ctx: Context, view: ObjectView, measured: MeasuredView | None) -> Measurements[Seen]:
    """The measurements of one object."""
    value = None if measured is None else Seen(view, measured)
    return Measurements(ctx, value, "the capture has no depth")
