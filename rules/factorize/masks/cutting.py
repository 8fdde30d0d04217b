"""Objects cropped from a photograph by their masks: crops, occluders, and the map of all objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import AssetSource, Support
from dextera_build.artifacts.objects.view import Instance, InstanceMap, MeasuredView, ObjectView, Segmentation, Traits
from dextera_build.geometry import upright

from ..measured import Measurements, Workspace
from ..overlap import crop
from ..regions.borders import touched
from ..regions.heights import relief
from .occlusion import lower_in_the_picture, occluders


@dataclass(frozen=True)
class Said:
    """Known properties of an object other than its pixels."""

    phrase: str
    """See `Element.phrase`."""
    traits: Traits
    """See `Instance.traits`."""
    source: AssetSource
    """Source of its mask."""


@dataclass(frozen=True)
class Cutter:
    """A photograph to cut objects out of."""

    photograph: Photograph
    measured: Measured | None
    support: Support | None
    depth: Measurements[Workspace]

    def cut_out(
        self, labels: np.ndarray, said: Mapping[str, Said], static: list[np.ndarray], margin: int
    ) -> Segmentation:
        """The objects of a map.

        Args:
            labels: (H, W) int32; 1, 2, ... are the objects of `said`, in its order.
            said: Name -> known properties of the object.
            static: Masks (H, W) bool of static elements, for a photograph without depth.
            margin: Margin of the photograph around a mask [px].
        """
        around = self.surroundings(labels, static)
        items = {
            name: self.instance(number, around, known, margin) for number, (name, known) in enumerate(said.items(), 1)
        }
        return Segmentation(items=items, names=tuple(said), map=InstanceMap(labels=labels, fixed=around.fixed))

    def surroundings(self, labels: np.ndarray, static: list[np.ndarray]) -> Surroundings:
        """Everything else in the picture; see `cut_out`."""
        if self.depth.taken:
            seen = self.depth.needed()
            raised = relief(seen).raised
            return Surroundings(labels, raised & (labels == 0), raised, seen.depth)
        turns = 0 if self.support is None else upright.turns(self.support.camera_pose.matrix)
        fixed = np.logical_or.reduce([np.zeros(labels.shape, bool), *static]) & (labels == 0)
        return Surroundings(labels, fixed, turns=turns)

    def instance(self, number: int, around: Surroundings, said: Said, margin: int) -> Instance:
        """One object, cropped from the photograph and its depth; its mask decides whether the border cuts it."""
        own = around.labels == number
        box = crop(own, margin)
        mask = np.ascontiguousarray(own[box])
        view = ObjectView(
            rgb=Image(pixels=np.ascontiguousarray(self.photograph.rgb.pixels[box])),
            mask=mask,
            occluder=around.hiding(number, box),
            camera=self.photograph.camera.crop(box[1].start, box[0].start, mask.shape[1], mask.shape[0]),
            phrase=said.phrase,
            asset_source=said.source,
        )
        traits = said.traits.model_copy(update={"cut": bool(touched(own))})
        return Instance(view=view, traits=traits, measured=_measured(self.measured, self.support, box))


Box = tuple[slice, slice]


@dataclass(frozen=True)
class Surroundings:
    """Everything else in the picture, from depth or from the masks alone."""

    labels: np.ndarray
    """(H, W) int32 instance labels."""
    fixed: np.ndarray
    """(H, W) bool, static elements."""
    raised: np.ndarray | None = None
    """(H, W) bool, measured pixels above the support; None without depth."""
    depth: np.ndarray | None = None
    """(H, W) float32 [m]; None without depth."""
    turns: int = 0
    """Counter-clockwise quarter turns that make the photograph upright."""

    def hiding(self, number: int, box: Box) -> np.ndarray:
        """Pixels of a crop where something nearer may occlude object `number`, (h, w) bool."""
        if self.raised is None or self.depth is None:
            labels, fixed = (upright.turned(picture, self.turns) for picture in (self.labels, self.fixed))
            lower = upright.turned(lower_in_the_picture(labels, fixed, number), -self.turns)
            return np.ascontiguousarray(lower[box])
        mask = np.ascontiguousarray(self.labels[box] == number)
        return occluders(mask, self.raised[box], self.depth[box].astype(np.float64))


def _measured(measured: Measured | None, support: Support | None, box: Box) -> MeasuredView | None:
    if measured is None or support is None:
        return None
    depth = DepthImage(depth=np.ascontiguousarray(measured.depth.depth[box]))
    return MeasuredView(depth=depth, camera_pose=support.camera_pose)
