"""Reference worlds: simulated workspaces with known ground truth, as substitutes for real ones."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, transforms


class Lamp(Value):
    """A directional light on the whole world."""

    direction: tuple[float, float, float]
    """Direction in which the light travels."""
    strength: float
    """Diffuse intensity; 1 fully lights a white surface that faces it."""
    shadow: bool = False
    """Whether it casts shadows."""


class Part(Artifact):
    """One textured piece of an object."""

    mesh: Mesh
    """Closed surface in the object's frame."""
    gloss: float = 0.0
    """Strength of highlights, 0..1."""
    pieces: tuple[Hull, ...] = ()
    """Convex pieces that together fill it, in the object's frame; used for contact."""


class Matter(Value):
    """Mechanical properties of a movable object."""

    mass_kg: float
    """Mass of the whole object [kg]; the density is uniform over each rigid piece."""
    friction: float
    """Sliding friction coefficient against any surface."""
    restitution: float = 0.1
    """Coefficient of restitution of a slow impact on the table."""


class Hinge(Value):
    """A hinge of an object, in the object's frame. The parts are stored as posed at `position`."""

    parts: tuple[str, ...]
    """The parts that move relative to the others."""
    origin: tuple[float, float, float]
    """A point on the axis [m]."""
    axis: tuple[float, float, float]
    """Unit direction; positive motion follows the right-hand rule and opens."""
    lower: float
    """Lower limit [rad]; 0 is closed."""
    upper: float
    """Upper limit [rad]."""
    position: float
    """Position in the photograph [rad]."""
    friction_nm: float
    """Dry friction [N m]."""
    damping_nms_rad: float
    """Viscous damping [N m s/rad]."""
    mass_kg: float
    """Mass of the moving parts, included in the object's mass [kg]."""


class Thing(Artifact):
    """An object of a reference world."""

    parts: dict[str, Part]
    """Textured pieces; they may overlap at joints between them."""
    surface: Mesh
    """The closed outer surface of all pieces together, in the object's frame."""
    pose: Annotated[Pose, Frames("reference", "thing")]
    """T_reference_thing."""
    matter: Matter | None = None
    """Mechanical properties; None for fixtures."""
    hinge: Hinge | None = None
    """Its hinge, if any."""


class RobotStand(Value):
    """Pose and joint positions of a robot."""

    position: tuple[float, float, float]
    """Origin of the robot's base [m]."""
    yaw: float
    """Rotation of the base about z [rad]."""
    joints: dict[str, float]
    """Joint -> position [rad or m]; omitted joints are at home."""

    def pose(self) -> Pose:
        """T_reference_base [m]."""
        matrix = transforms.rigid(lie.about_z(self.yaw), np.array(self.position))
        return Pose(parent="reference", child="base", matrix=matrix)


class World(Artifact):
    """A reference world. Its frame, `reference`: z up, the table's top is z = 0."""

    objects: dict[str, Thing]
    """Objects on the table, by name; included in the ground truth."""
    fixtures: dict[str, Thing]
    """Table, pedestal, floor, wall: everything else except the robot."""
    lamps: tuple[Lamp, ...]
    """Lights."""
    ambient: float
    """Intensity of ambient light, 0..1."""
    stand: RobotStand | None = None
    """The robot's pose; None without a robot."""
    camera: Camera
    """Intrinsics."""
    camera_pose: Annotated[Pose, Frames("reference", "camera")]
    """T_reference_camera, OpenCV axes."""
