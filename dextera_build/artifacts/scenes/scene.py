"""Whole scenes: background, simulator models, settle reports, ground truth of reference worlds."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Array, Artifact, Folder, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image, LabelImage
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.objects.object import AssetSource, ScaleSource
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose


class SupportBox(Value):
    """An upright collision box of the static scene, in the world frame."""

    name: str
    """Unique."""
    centre: tuple[float, float, float]
    """Centre [m]."""
    half_size: tuple[float, float, float]
    """Half edge lengths [m]."""
    yaw: float = 0.0
    """Rotation about world z [rad]."""


class Background(Artifact):
    """The static scene with the objects removed."""

    image: Image
    """The photograph with objects inpainted."""
    depth: DepthImage
    """Its depth."""
    mesh: Mesh
    """Textured surface in the world frame that is visible in the photograph, or visible after the removal of
    objects."""
    invented: Mesh | None = None
    """Textured surfaces in the world frame without a visible pixel: behind and next to visible ones, the support's
    sides and underside, and the walls, floor and ceiling that close the room; None: there are none."""
    boxes: tuple[SupportBox, ...]
    """Collision geometry; the first one is the support with its top at z = 0."""
    asset_source: AssetSource = "rgb"
    """Source of the surface."""


class Scene(Artifact):
    """A simulated scene that loads in MuJoCo."""

    model: Folder
    """`scene.xml` and the files that it names, relative."""
    camera: Camera
    """The photograph's intrinsics; the MJCF camera is called `capture`."""
    camera_pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera, OpenCV axes."""
    bodies: tuple[str, ...]
    """Names of the movable objects; each is the name of its MJCF root body."""
    held: dict[str, str] = Field(default_factory=dict)
    """Objects that would not rest and are therefore fixed as part of the static scene: name -> why, see
    `simulate.steady`."""
    cut: tuple[str, ...] = ()
    """Names of the objects, movable or held, that the picture's border cuts."""
    scale: ScaleSource = "depth"
    """Source of the unit of length; tasks refuse a scene of scale `unknown`."""


class Settled(Value):
    """Motion of one body after the scene was released."""

    name: str
    """Body."""
    drift_m: float
    """Distance that its origin moved [m]."""
    tilt_rad: float
    """Angle of its rotation [rad]."""
    penetration_m: float
    """Deepest contact, at the start or at the end [m]."""
    joint_drift: float = 0.0
    """Largest change of one of its joints' positions [rad or m]."""
    resting: bool
    """Whether it is at rest at the end, as upright as at the start, and still above the support."""


class SettleReport(Artifact):
    """Result of the settle check."""

    bodies: tuple[Settled, ...]
    """One row per body."""
    seconds: float
    """Simulated time [s]."""
    energy_j: Annotated[np.ndarray, Array("T", "float64", unit="J")]
    """Kinetic energy over time."""
    energy_change: float | None = None
    """Largest change of the mechanical energy after settling, relative to m g h of the bodies; None: not measured."""
    passed: bool
    """Whether every body rests, and none gains or loses energy."""


class TruthObject(Artifact):
    """Ground truth of one object of a reference world."""

    mesh: Mesh
    """Surface in the frame `reference`, as posed."""
    label: int
    """Its label in `Truth.labels`."""


class Truth(Artifact):
    """The true state of a reference world; only `evaluate.*` may use it."""

    objects: dict[str, TruthObject]
    """Name -> object; the robot and the table are not among them."""
    labels: LabelImage
    """Visible instances in the capture's camera."""
    rgb: Image
    """Noise-free picture."""
    depth: DepthImage
    """Noise-free depth."""
    camera: Camera
    """Intrinsics."""
    camera_pose: Annotated[Pose, Frames("reference", "camera")]
    """True T_reference_camera."""
