"""A simulator-independent description of a scene, from which MJCF and USD are written."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError, listing
from dextera_build.geometry import kinematics, transforms

Name = Annotated[str, Field(pattern="^[A-Za-z_][A-Za-z0-9_]*$")]
"""A name that is valid in MJCF and USD."""
Vector = tuple[float, float, float]
WORLD = "world"
"""Parent of static geoms."""


class Material(Value):
    """Appearance of a surface in addition to the colour or the texture of its mesh."""

    unlit: bool = False
    """Whether its texture includes the light of the photograph and is shown unlit."""
    roughness: float = Field(0.9, ge=0, le=1)
    """Roughness of a microfacet model; USD only."""
    gloss: float = Field(0.0, ge=0, le=1)
    """Strength of highlights; MJCF only."""


class Contact(Value):
    """Contact properties of a surface."""

    friction: NonNegativeFloat
    """Sliding friction coefficient."""
    restitution: float = Field(ge=0, le=1)
    """Coefficient of restitution."""
    stiffness_n_m: PositiveFloat | None = None
    """Contact stiffness of the whole object [N/m]; None: that of a hard object, see `sim.model.mjcf_contact`."""


class Box(Value):
    """A box around the origin of its geom."""

    half_size: tuple[PositiveFloat, PositiveFloat, PositiveFloat]
    """Half edge lengths [m]."""


class Geom(Artifact):
    """A shape fixed to a body or to the world, either visual or for collision."""

    label: Name
    """Unique in the scene."""
    role: Literal["visual", "collision"]
    """Visual shapes have no contacts, and collision shapes are hidden."""
    shape: Mesh | Hull | Box
    """In the frame `geom`; a visual shape is a `Mesh`, a collision shape a `Hull` or `Box`."""
    pose: Annotated[Pose, Frames("body", "geom")]
    """T_body_geom; of a static geom T_world_geom."""
    material: Material | None = None
    """Material of a visual shape."""
    contact: Contact | None = None
    """Contact properties of a collision shape; None: the simulator's defaults, as for static geoms."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.role == "visual") != isinstance(self.shape, Mesh):
            raise ArtifactError(
                f"geom `{self.label}` is for {self.role}, but it is a {type(self.shape).__name__}",
                code="DXB-A421",
                hint="a visual geom is a Mesh, one for collision a Hull or a Box",
            )
        return self

    def vertices(self) -> np.ndarray:
        """Corners (V, 3) float64 of its mesh, hull or box in the body's frame [m]."""
        if isinstance(self.shape, Box):
            signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
            return transforms.apply(self.pose.matrix, signs * self.shape.half_size)
        turn, shift = self.pose.matrix[:3, :3], self.pose.matrix[:3, 3]
        if np.array_equal(turn, np.eye(3)):
            return np.asarray(self.shape.vertices + shift)
        return transforms.apply(self.pose.matrix, self.shape.vertices.astype(np.float64))


class Inertia(Value):
    """Mass properties of a body, in its frame."""

    mass_kg: PositiveFloat
    """[kg]"""
    centre: Vector
    """Centre of mass [m]."""
    moments: tuple[float, float, float, float, float, float]
    """ixx, iyy, izz, ixy, ixz, iyz about the centre of mass [kg m^2]."""


class BodyNode(Artifact):
    """One rigid part of an object. Its frame is at its joint, parallel to the object frame."""

    label: Name
    """Unique in the scene; that of a root is the object's."""
    inertia: Inertia
    """Always explicit, because simulators estimate it incorrectly from thin and open meshes."""
    geoms: tuple[Geom, ...]
    """Shapes fixed to it."""


class JointNode(Value):
    """One joint between two parts, in the object frame with every joint at 0."""

    name: str
    """Unique in the object."""
    type: Literal["revolute", "prismatic"]
    """Kind of motion."""
    parent: str
    """Part nearer to the root."""
    child: str
    """Moving part."""
    origin: Vector
    """A point on the axis [m]; the frame of the child is there."""
    axis: Vector
    """Direction; positive motion follows the right-hand rule."""
    lower: float
    """Lower limit [rad or m]; not above `position`."""
    upper: float
    """Upper limit [rad or m]; not below `position`."""
    position: float
    """Position in the home keyframe [rad or m]."""
    friction: NonNegativeFloat
    """Dry friction [N m or N]."""
    damping: NonNegativeFloat
    """Viscous damping [N m s/rad or N s/m]."""


class ObjectNode(Artifact):
    """A free object: a tree of parts."""

    pose: Annotated[Pose, Frames("world", "object")]
    """T_world_object in the home keyframe."""
    links: dict[str, BodyNode]
    """Part -> its body."""
    joints: tuple[JointNode, ...] = ()
    """A tree over the parts."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        ends = [end for joint in self.joints for end in (joint.parent, joint.child)]
        if unknown := sorted(set(ends) - self.links.keys()):
            raise ArtifactError(
                f"a joint names the part `{unknown[0]}`, which the object does not have",
                code="DXB-A422",
                facts={"parts": listing(self.links)},
            )
        roots = self.links.keys() - {joint.child for joint in self.joints}
        if len(roots) != 1 or len(self.joints) != len(self.links) - 1:
            raise ArtifactError(
                f"the parts of an object are not one tree: {len(self.links)} parts, {len(self.joints)} joints",
                code="DXB-A422",
                facts={"parts without a joint above them": listing(roots)},
            )
        for joint in self.joints:
            if not joint.lower <= joint.position <= joint.upper:
                raise ArtifactError(
                    f"joint `{joint.name}` is at {joint.position:g}, outside {joint.lower:g} to {joint.upper:g}",
                    code="DXB-A423",
                    hint="widen its limits, or move it",
                )
        kinematics.link_poses(self)  # raises for joints in a circle
        return self

    @property
    def label(self) -> str:
        """Its name: that of its root body."""
        return self.links[self.root].label

    @property
    def root(self) -> str:
        """The part without a joint above it."""
        moved = {joint.child for joint in self.joints}
        return next(part for part in self.links if part not in moved)

    @property
    def mass_kg(self) -> float:
        """Mass of all its parts [kg]."""
        return sum(body.inertia.mass_kg for body in self.links.values())

    def origin(self, part: str) -> np.ndarray:
        """Origin (3,) of a part's frame in the object frame, with every joint at 0 [m]."""
        above = next((joint for joint in self.joints if joint.child == part), None)
        return np.zeros(3) if above is None else np.asarray(above.origin)

    def world_poses(self) -> dict[str, np.ndarray]:
        """Part -> (4, 4) T_world_body in the home keyframe."""
        poses = kinematics.link_poses(self)
        return {
            part: self.pose.matrix @ poses[part] @ transforms.rigid(np.eye(3), self.origin(part)) for part in self.links
        }


class Light(Value):
    """A light that shines on everything from one direction."""

    label: Name
    """Unique in the scene."""
    direction: Vector
    """Direction in which the light travels."""
    place: Vector
    """Position for display, and origin of its shadows [m]."""
    diffuse: Vector
    """Red, green, blue, 0..1."""


class CameraNode(Artifact):
    """A static camera."""

    label: Name
    """Unique in the scene."""
    camera: Camera
    """Intrinsics."""
    pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera, OpenCV axes."""


class Attachment(Artifact):
    """A robot fixed to the world."""

    prefix: str = Field(pattern="^[a-z][a-z0-9_]*/$")
    """Prefix of all names of the robot in the scene: `robot/`."""
    robot: RobotModel
    """The robot, at its home position."""
    pose: Annotated[Pose, Frames("world", "base")]
    """T_world_base."""


class SceneDescription(Artifact):
    """A scene: world frame z up; poses and joint positions of the nodes are the home keyframe."""

    objects: tuple[ObjectNode, ...]
    """Free objects."""
    static: tuple[Geom, ...]
    """Shapes that never move, in the world frame."""
    cameras: tuple[CameraNode, ...]
    """The first one is that of the photograph."""
    lights: tuple[Light, ...] = ()
    """Lights in addition to the viewer's own."""
    backdrop: Vector = (0.5, 0.5, 0.5)
    """Background colour, sRGB 0..1."""
    exclude: tuple[tuple[str, str], ...] = ()
    """Pairs of bodies without contacts, except for the geoms in `touch`."""
    touch: tuple[tuple[Name, Name], ...] = ()
    """Pairs of collision geoms of one object with contacts nevertheless."""
    attachments: tuple[Attachment, ...] = ()
    """Robots in the scene."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for kind, names in self._names().items():
            if double := [name for name, times in Counter(names).items() if times > 1]:
                raise ArtifactError(
                    f"two {kind} of a scene are called `{double[0]}`", code="DXB-A424", hint="rename one of them"
                )
        bodies = self._names()["bodies"]
        for pair in self.exclude:
            if unknown := [name for name in pair if name not in bodies]:
                raise ArtifactError(
                    f"the scene excludes contacts of `{unknown[0]}`, which is no body of it",
                    code="DXB-A424",
                    facts={"bodies": listing(bodies)},
                )
        for pair in self.touch:
            if missing := [name for name in pair if name not in self._names()["geoms"]]:
                raise ArtifactError(
                    f"the scene lets `{missing[0]}` touch something, which is no geom of it", code="DXB-A424"
                )
        return self

    def _names(self) -> dict[str, list[str]]:
        parts = [body for thing in self.objects for body in thing.links.values()]
        geoms = [*self.static, *(geom for body in parts for geom in body.geoms)]
        return {
            "bodies": [body.label for body in parts],
            "geoms": [geom.label for geom in geoms],
            "cameras": [camera.label for camera in self.cameras],
            "lights": [light.label for light in self.lights],
            "attachments": [attachment.prefix for attachment in self.attachments],
        }

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the movable objects' root bodies."""
        return tuple(thing.label for thing in self.objects)
