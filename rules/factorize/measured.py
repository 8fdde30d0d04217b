"""Measured depth for backends that make assets; reading it labels the result `rgbd`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Measured, Photograph
from dextera_build.artifacts.cameras.image import Image, LabelImage
from dextera_build.artifacts.objects.object import AssetSource, Element, Support
from dextera_build.artifacts.objects.view import FurtherViews, MeasuredView, ObjectView, Seen
from dextera_build.geometry import cameras, regions, upright
from dextera_build.geometry.depth_view import DepthView
from dextera_build.rule import Context

T = TypeVar("T")


@dataclass(frozen=True)
class Workspace(DepthView):
    """A photograph with the depth of the same pixels, in the world frame of its support."""

    photograph: Photograph
    depth: np.ndarray
    """(H, W) float32 image-plane z [m]; 0 where nothing was measured."""
    support: Support
    robot: np.ndarray | None = None
    """(H, W) bool, pixels of the robot, which is never an object; None if no robot is known."""

    @property
    def pixels(self) -> np.ndarray:
        """(H, W, 3) uint8 sRGB."""
        return self.photograph.rgb.pixels

    @property
    def camera(self) -> Camera:
        """Intrinsics of photograph and depth."""
        return self.photograph.camera

    @property
    def k(self) -> np.ndarray:
        """(3, 3) intrinsics [px]."""
        return self.camera.matrix()

    @property
    def world_from_camera(self) -> np.ndarray:
        """T_world_camera, (4, 4)."""
        return self.support.camera_pose.matrix

    @property
    def turns(self) -> int:
        """Counter-clockwise quarter turns that make the photograph upright."""
        return upright.turns(self.world_from_camera)

    def over_support(self, margin_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (H, W) bool whose line of sight meets the support's plane, and its depth there [m].

        Inside the support's outline, or at most `margin_m` beyond it [m].
        """
        pose = self.world_from_camera
        rays = cameras.rays(self.camera.height, self.camera.width, self.k) @ pose[:3, :3].T
        ahead = rays[..., 2] < -1e-6
        depth = pose[2, 3] / np.where(ahead, -rays[..., 2], 1.0)
        meets = pose[:2, 3] + rays[..., :2] * depth[..., None]
        inside = ahead & regions.inside_convex(meets, self.support.polygon, margin_m)
        return np.asarray(inside), np.where(inside, depth, 0.0)

    def upright(self) -> Workspace:
        """The same scene as seen by an upright camera: the photograph turned by `turns`, the same world."""
        if not self.turns:
            return self
        camera = self.camera.turned(self.turns)
        pose = self.support.camera_pose
        matrix = pose.matrix @ upright.turned_from_camera(-self.turns)
        return Workspace(
            Photograph(rgb=Image(pixels=upright.turned(self.pixels, self.turns)), camera=camera),
            upright.turned(self.depth, self.turns),
            self.support.model_copy(update={"camera_pose": pose.model_copy(update={"matrix": matrix})}),
            None if self.robot is None else upright.turned(self.robot, self.turns),
        )


def turned_elements(elements: Iterable[Element], size: tuple[int, int], count: int) -> tuple[Element, ...]:
    """Elements with their boxes in the picture, `size` wide and high, after `count` quarter turns of it."""
    return tuple(
        element.model_copy(update={"box": element.box and upright.turned_box(element.box, size, count)})
        for element in elements
    )


class Measurements(Generic[T]):
    """Optional measurements, and whether a backend has read them.

    Args:
        ctx: The rule's context.
        value: The measurements; None if there is only the photograph.
        lacking: Explanation if there are none: `the capture has no depth`.
        unmeasured: The same without depth, for backends that need only the pose of the camera over the support.
        metric: Whether that pose is in metres; the scale of a photograph alone may be unknown.
    """

    def __init__(
        self, ctx: Context, value: T | None, lacking: str, unmeasured: T | None = None, *, metric: bool = True
    ) -> None:
        self._ctx = ctx
        self._value = value
        self._lacking = lacking
        self.unmeasured = unmeasured
        self.metric = metric
        self.taken = False
        """Whether the backend made its result with them."""

    def needed(self) -> T:
        """The measurements; reading them labels the result `rgbd`.

        Raises:
            RuleError: There are none, and this backend requires them.
        """
        self.taken = True
        if self._value is None:
            self._ctx.fail(
                f"this backend makes assets with the help of measured depth, but {self._lacking}",
                hint="add the depth to the capture, or build with `--profile picture` and the input `description`, a "
                "`scene.yaml` with a box per object",
            )
        return self._value

    def for_check(self) -> T | None:
        """The measurements for a metric or a picture that does not affect the result, or None."""
        return self._value

    def source(self, *inputs: AssetSource) -> AssetSource:
        """The label of a result made from `inputs` and, if they were read, from the measurements."""
        return "rgbd" if self.taken or "rgbd" in inputs else "rgb"


def of_workspace(
    ctx: Context,
    photograph: Photograph,
    measured: Measured | None,
    support: Support | None,
    machine: np.ndarray | None = None,
) -> Measurements[Workspace]:
    """The measurements of a whole photograph, with the robot's pixels, `machine` (H, W) bool.

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
    return Measurements(ctx, Workspace(photograph, without_dropout(depth), support, machine), "")


def robot_pixels(ctx: Context, photograph: Photograph, robot: LabelImage | None) -> np.ndarray | None:
    """Pixels (H, W) bool of the robot; None if no robot is known.

    Raises:
        RuleError: They are of a picture of another size.
    """
    if robot is None:
        return None
    size, machine = photograph.rgb.pixels.shape[:2], np.asarray(robot.labels != 0)
    if machine.shape != size:
        ctx.fail(
            "the robot's pixels are of another picture",
            photograph=f"{size[1]} x {size[0]} px",
            robot=f"{machine.shape[1]} x {machine.shape[0]} px",
            hint="make them with `background.robot` and the camera of this photograph",
        )
    return machine


SCATTERED = 0.1
"""Smallest fraction of the measured area in scattered gaps at which they are dropout and are filled."""


def without_dropout(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) [m] with single lost pixels filled from their neighbours if many are lost; else unchanged.

    A gap between a near and a far surface is filled with the near one, which loses more pixels in depth cameras.
    """
    from scipy import ndimage

    valid = depth > 0
    around = ndimage.uniform_filter(valid.astype(np.float32), 5) > 0.3
    if (around & ~valid).sum() < SCATTERED * around.sum():
        return depth
    filled = depth
    for _ in range(3):
        low = ndimage.minimum_filter(np.where(filled > 0, filled, np.inf), 3)
        near = (filled > 0) & (filled < 1.03 * low)
        sums = [ndimage.uniform_filter(x.astype(np.float64), 3) for x in (np.where(near, filled, 0.0), near)]
        mean = np.divide(sums[0], sums[1], out=np.zeros(depth.shape), where=sums[1] > 0.3)
        filled = np.where((filled <= 0) & around, mean, filled)
    return np.asarray(filled.astype(np.float32))


def of_view(
    ctx: Context,
    view: ObjectView,
    measured: MeasuredView | None,
    support: Support | None = None,
    further: FurtherViews | None = None,
) -> Measurements[Seen]:
    """The measurements of one object; `support` gives the pose of the camera where nothing was measured."""
    others = () if further is None else tuple(Seen(one.view, one.measured) for one in further.items)
    value = None if measured is None else Seen(view, measured, others)
    bare = None if support is None else Seen.without_depth(view, support.camera_pose)
    metric = support is None or support.scale != "unknown"
    return Measurements(ctx, value, "the capture has no depth", bare, metric=metric)
