"""Data of each object in the photograph: pixels for its asset, measurements for its placement, traits for physics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.objects.object import AssetSource, Estimate, JointHint
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import upright
from dextera_build.geometry.depth_view import DepthView


class ObjectView(Artifact):
    """One object in the photograph: a crop. It contains no measurements, and neither name nor traits of the object."""

    rgb: Image
    """Crop of the photograph around the mask, with a margin."""
    mask: Annotated[np.ndarray, Array("H W", "bool")]
    """Visible pixels of the object, in the crop, and those added by `factorize.complete` at pixels of `occluder`."""
    occluder: Annotated[np.ndarray, Array("H W", "bool")]
    """Pixels of the crop where something nearer may hide the object."""
    camera: Camera
    """Intrinsics of the crop."""
    phrase: str
    """See `Element.phrase`."""
    asset_source: AssetSource = "rgb"
    """Source of the mask."""


class MeasuredView(Artifact):
    """Measurements in the crop of an `ObjectView`."""

    depth: DepthImage
    """The same crop of the depth [m]."""
    camera_pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera; the support is z = 0."""


class State(Artifact):
    """A second capture of objects on a support, with their joints in other positions."""

    measured: MeasuredView
    """Depth of the whole picture, and T_world_camera in the world of this picture's own support."""
    camera: Camera
    """Intrinsics."""
    above: Annotated[np.ndarray, Array("H W", "bool")]
    """Measured pixels of objects on the support."""


class Traits(Artifact):
    """Properties of an object from parsing; separate from its view, so that a new material rebuilds no mesh."""

    category: str
    """See `Element.category`."""
    body_type: Literal["rigid", "articulated"]
    """See `Element.body_type`."""
    material: str
    """See `Element.material`."""
    material_confidence: float | None = None
    """See `Element.material_confidence`."""
    estimate: Estimate | None = None
    """See `Element.estimate`."""
    cut: bool = False
    """Whether the picture's border cuts its mask; what is outside the picture is completed by symmetry."""
    phrase: str = ""
    """See `Element.phrase`; its colour and what it is called."""
    joints: tuple[JointHint, ...] = ()
    """See `Element.joints`."""


class FurtherView(Artifact):
    """One object in a further photograph, see `FurtherPhotographs`."""

    file: str
    """The photograph's file."""
    view: ObjectView
    """Its pixels."""
    measured: MeasuredView
    """Its depth, in the world of the first photograph's support."""


class FurtherViews(Artifact):
    """An object in all further photographs that show it."""

    items: tuple[FurtherView, ...]
    """In the order of the photographs."""


class Instance(Artifact):
    """One segmented object. Its name is not included, so that renaming rebuilds nothing."""

    view: ObjectView
    """Its pixels."""
    traits: Traits
    """Its properties."""
    measured: MeasuredView | None = None
    """Its depth; None if there is only the photograph."""
    further: FurtherViews | None = None
    """The same object in further photographs; None if none shows it."""


class InstanceMap(Artifact):
    """The object of each pixel of a whole photograph, without names and traits."""

    labels: Annotated[np.ndarray, Array("H W", "int32")]
    """0 is everything else; 1.. are instances."""
    fixed: Annotated[np.ndarray, Array("H W", "bool")]
    """Pixels of static elements: the robot, and objects cut by the image border."""


class Segmentation(Artifact):
    """All objects and the map from which they were cropped."""

    items: dict[str, Instance]
    """Element name -> object; opened by `each`."""
    names: tuple[str, ...]
    """Name of label 1, 2, ... of `map`."""
    map: InstanceMap
    """Their pixels in the full photograph."""

    def mask(self, name: str) -> np.ndarray:
        """Pixels (H, W) bool of an object in the full photograph."""
        return np.asarray(self.map.labels == self.names.index(name) + 1)


@dataclass(frozen=True)
class Seen(DepthView):
    """A view with its measurements, for code that needs both."""

    view: ObjectView
    measured: MeasuredView
    others: tuple[Seen, ...] = ()
    """The same object in further photographs, in the same world."""

    @classmethod
    def without_depth(cls, view: ObjectView, camera_pose: Pose) -> Seen:
        """A view of which nothing was measured, by a camera at `camera_pose`, T_world_camera."""
        nothing = DepthImage(depth=np.zeros(view.mask.shape, np.float32))
        return cls(view, MeasuredView(depth=nothing, camera_pose=camera_pose))

    @property
    def rgb(self) -> np.ndarray:
        """The crop's pixels, (H, W, 3) uint8."""
        return self.view.rgb.pixels

    @property
    def mask(self) -> np.ndarray:
        """See `ObjectView.mask`."""
        return self.view.mask

    @property
    def occluder(self) -> np.ndarray:
        """See `ObjectView.occluder`."""
        return self.view.occluder

    @property
    def camera(self) -> Camera:
        """See `ObjectView.camera`."""
        return self.view.camera

    @property
    def k(self) -> np.ndarray:
        """(3, 3) intrinsics of the crop [px]."""
        return self.camera.matrix()

    @cached_property
    def depth(self) -> np.ndarray:
        """The crop's depth, (H, W) float32 [m]; 0 where nothing was measured, or only the occluder."""
        completed = self.mask & self.occluder
        depth = self.measured.depth.depth
        return np.where(completed, np.float32(0.0), depth) if completed.any() else depth

    @property
    def world_from_camera(self) -> np.ndarray:
        """T_world_camera, (4, 4)."""
        return self.measured.camera_pose.matrix

    def upright(self) -> Seen:
        """The same view as seen by an upright camera, see `geometry.upright`; the world is unchanged."""
        others = tuple(other.upright() for other in self.others)
        count = upright.turns(self.world_from_camera)
        if not count:
            return replace(self, others=others) if others else self
        view, pose = self.view, self.measured.camera_pose
        matrix = pose.matrix @ upright.turned_from_camera(-count)
        return Seen(
            view.model_copy(
                update={
                    "rgb": Image(pixels=upright.turned(self.rgb, count)),
                    "mask": upright.turned(self.mask, count),
                    "occluder": upright.turned(self.occluder, count),
                    "camera": self.camera.turned(count),
                }
            ),
            MeasuredView(
                depth=DepthImage(depth=upright.turned(self.measured.depth.depth, count)),
                camera_pose=pose.model_copy(update={"matrix": matrix}),
            ),
            others,
        )
