"""An object and its derived data, from pixels to a simulation-ready asset."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose

AssetSource: TypeAlias = Literal["rgb", "rgbd"]
"""Source of an asset: the photograph alone, as in the paper, or with measured depth."""


ScaleSource: TypeAlias = Literal["depth", "marker", "robot", "size", "unknown"]
"""Source of the metric scale: measured depth, a marker, the robot's calibration, a stated size, or none."""


class JointHint(Value):
    """A stated joint; pixels are those of the whole photograph."""

    type: Literal["revolute", "prismatic"]
    """Kind of motion."""
    part_px: tuple[int, int, int, int]
    """left, top, right, bottom of the flat front of the moving part [px], right and bottom excluded."""
    axis_px: tuple[tuple[float, float], tuple[float, float]] | None = None
    """Two pixels on the axis; positive motion follows the right-hand rule from the first to the second, or is
    directed from the first to the second. None for a slide out of the front."""
    range: tuple[float, float] | None = None
    """Lower and upper limit [rad or m]."""
    position: float = 0.0
    """Position in the photograph [rad or m]; 0 is closed."""


class Estimate(Value):
    """Physical properties that a vision-language model states from looking; intervals hold 90 % of such things."""

    phrase: str
    """What it calls the thing."""
    mass_kg: tuple[float, float]
    """Mass with its contents [kg]."""
    friction: tuple[float, float]
    """Sliding friction coefficient against the support."""
    restitution: tuple[float, float]
    """Coefficient of restitution of a slow impact on the support."""


class Element(Value):
    """One element of the photograph, found by parsing."""

    name: str
    """Unique name, lower case, words joined by `_`; the label of everything made from it."""
    category: str
    """Category: `box`, `cylinder`, `bowl`, `mug`, `laptop`, `support`, `robot`, `room`, `object`."""
    phrase: str
    """A short noun phrase for grounding: `blue mug`."""
    body_type: Literal["rigid", "articulated"] = "rigid"
    """Whether it has joints."""
    interactive: bool = True
    """True: a foreground asset. False: part of the static background."""
    box: tuple[int, int, int, int] | None = None
    """left, top, right, bottom [px], right and bottom excluded; None while unknown."""
    material: str = "plastic"
    """Key of the material table."""
    material_confidence: float | None = None
    """Probability that it is this material: 1 if stated by the user; None if the proposer has no estimate."""
    estimate: Estimate | None = None
    """Physical properties as the proposer states them; None if it states none."""
    cut: bool = False
    """Whether the picture's border cuts it, as proposed; of an object, `Traits.cut` says it."""
    joints: tuple[JointHint, ...] = ()
    """Joints stated by the user."""


class Elements(Artifact):
    """The result of parsing."""

    elements: tuple[Element, ...]
    """Every element, interactive and static."""
    source: str = "proposed"
    """`proposed` or `scene.yaml`."""
    asset_source: AssetSource = "rgb"
    """Data from which the elements were proposed."""
    regions: Annotated[np.ndarray, Array("H W", "int32")] | None = None
    """Region above the support of each pixel of the photograph, 1.. from the largest, 0 elsewhere; None if the elements
    were not proposed from regions."""


class Support(Artifact):
    """The plane that objects stand on, and the metric world frame that it defines.

    World: origin on the plane at the centre of the visible support, z along the plane's normal (up), x the camera's
        right projected onto the plane, y = z cross x (away from the camera).
    """

    camera_pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera, camera in OpenCV axes."""
    polygon: Annotated[np.ndarray, Array("P 2", "float64", unit="m", frame="world")]
    """Convex outline of the visible support, counter-clockwise."""
    residual_m: float | None = None
    """Root mean square distance of the inliers to the plane [m]; None without depth."""
    inlier_fraction: float | None = None
    """Fraction of the valid depth pixels that are on the plane; None without depth."""
    scale: ScaleSource = "depth"
    """Source of the unit of length. `unknown`: the camera is one unit above the support, of unknown length."""
    factor: float = 1.0
    """Length in this world per length in the world that objects were placed in."""


class Rival(Value):
    """The second-best hypothesis of a shape."""

    hypothesis: str
    """Its name."""
    volume_ratio: float
    """Its volume over that of the best one."""
    hollow: bool
    """Whether it has a cavity, so that its volume is that of its walls."""
    gap: float
    """Score of the best one minus its own."""


class Certainty(Value):
    """Uncertainty of a shape."""

    unseen_fraction: float
    """See `Shape.unseen_fraction`."""
    residual_m: float | None = None
    """See `Shape.residual_m`."""
    size_sigma: float | None = None
    """See `Shape.size_sigma`."""
    volume_sigma: float | None = None
    """See `Shape.volume_sigma`."""
    rival: Rival | None = None
    """See `Shape.rival`."""


class Shape(Artifact):
    """A closed, textured mesh of one object, with its agreement with the photograph."""

    mesh: Mesh
    """Closed, in the object frame: origin at the centre of the base, z up in its resting pose."""
    walls: tuple[Hull, ...] = ()
    """Exact convex pieces if known to the hypothesis (walls of a hollow body), object frame; else empty."""
    pose: Annotated[Pose, Frames("world", "object")] | None = None
    """Initial T_world_object, which `align.object` refines; None without measurements. Its covariance is that of the
    object frame due to unknown parameters of the shape."""
    hypothesis: str
    """The best hypothesis: `box`, `cylinder`, `revolved`, `extruded`, `mirrored`, ..."""
    hollow: bool
    """Whether the mesh has a cavity that is open at the top."""
    residual_m: float | None = None
    """Median absolute depth difference between render and view on their common pixels [m]; None without depth."""
    mask_iou: float
    """Intersection over union of the rendered and the seen mask (without occluded pixels)."""
    unseen_fraction: float
    """Fraction of the surface area that no photograph shows."""
    further_seen: tuple[float, ...] = ()
    """Fraction of it that each further photograph of the object shows, and none before it."""
    scores: dict[str, float]
    """Hypothesis -> render score, higher is better."""
    unobserved: tuple[str, ...] = ()
    """Sizes that the view does not determine, so that they are guesses: `x`, `y` or `z` of the mesh."""
    size_sigma: float | None = None
    """Standard deviation of the log of its size, given the hypothesis; None if the backend states none."""
    volume_sigma: float | None = None
    """Standard deviation of its log volume, given the hypothesis; None if the backend states none."""
    rival: Rival | None = None
    """The second-best hypothesis; None if there is only one."""
    asset_source: AssetSource = "rgb"
    """Source of the mesh."""

    def certainty(self) -> Certainty:
        """The uncertainty, which bodies made from the shape keep."""
        return Certainty(**{name: getattr(self, name) for name in Certainty.model_fields})


class Joint(Value):
    """One joint between two links, in the object frame at joint position 0."""

    name: str
    """Unique in the body."""
    type: Literal["revolute", "prismatic"]
    """Kind of motion."""
    parent: str
    """Link nearer to the root."""
    child: str
    """Moving link."""
    origin: tuple[float, float, float]
    """A point on the axis [m]."""
    axis: tuple[float, float, float]
    """Unit direction; positive motion follows the right-hand rule."""
    lower: float
    """Lower limit [rad or m]."""
    upper: float
    """Upper limit [rad or m]."""
    position: float
    """Position in the photograph [rad or m]."""
    lower_range: tuple[float, float] | None = None
    """Interval that contains the lower limit [rad or m]: from the collision-free to the observed position; None if
    not stated."""
    upper_range: tuple[float, float] | None = None
    """Interval that contains the upper limit [rad or m]: from the observed to the collision-free position; None if
    not stated."""
    axis_sigma_rad: float | None = None
    """Standard deviation of the axis' direction [rad]; None if not stated."""
    origin_sigma_m: float | None = None
    """Standard deviation of the axis' position [m]; None if not stated."""


class Link(Artifact):
    """One rigid part. Geometry is in the object frame with every joint at position 0."""

    mesh: Mesh
    """Closed surface."""
    walls: tuple[Hull, ...] = ()
    """See `Shape.walls`."""


class Body(Artifact):
    """An object's links and joints. A rigid object has one link, `base`, and no joint."""

    links: dict[str, Link]
    """Name -> link; `base` is the root."""
    joints: tuple[Joint, ...] = ()
    """A tree over the links."""
    pose: Annotated[Pose, Frames("world", "object")] | None = None
    """See `Shape.pose`."""
    hollow: bool = False
    """See `Shape.hollow`."""
    asset_source: AssetSource = "rgb"
    """Source of links and joints."""
    certainty: Certainty | None = None
    """Uncertainty of the shape; None if unknown."""

    @property
    def residual_m(self) -> float | None:
        """Median distance of the measured depth from the shape [m]; None if unknown."""
        return None if self.certainty is None else self.certainty.residual_m


class Inertial(Value):
    """Mass properties of one link with their uncertainty; the link frame is the object frame at joint positions 0."""

    mass_kg: float
    """Best estimate [kg]."""
    mass_low_kg: float
    """Lower end of the 90 % interval [kg]."""
    mass_high_kg: float
    """Upper end of the 90 % interval [kg]."""
    centre: tuple[float, float, float]
    """Centre of mass [m]."""
    inertia: tuple[float, float, float, float, float, float]
    """ixx, iyy, izz, ixy, ixz, iyz about the centre of mass [kg m^2]; scales with the mass."""
    source: str
    """`material table: ceramic, solid volume`."""


class Physics(Artifact):
    """Mass, inertia and contact properties of every link."""

    links: dict[str, Inertial]
    """Link -> mass properties."""
    friction: float
    """Sliding friction coefficient."""
    friction_sigma: float
    """Standard deviation of `friction`."""
    restitution: float
    """Coefficient of restitution."""
    restitution_sigma: float = 0.1
    """Standard deviation of `restitution`."""
    stiffness_n_m: float | None = None
    """Contact stiffness of its surface [N/m]; None: that of a hard object."""
    material: str
    """Key of the material table."""
    weighed: bool = False
    """Whether the masses are weighed and thus independent of the scale, or follow from a density."""


class Pieces(Artifact):
    """Convex pieces of one link."""

    hulls: tuple[Hull, ...]
    """At least one."""
    method: str
    """`walls`, `hull`, `wedges` (cuts about the vertical: a container, or a link that exceeds CoACD's time limit),
    `coacd`."""
    cavity_fill: float | None = None
    """Fraction of the cavity's volume that the pieces fill; None without a cavity."""
    excess: float | None = None
    """Volume of the union of the pieces outside the link, relative to the link's volume; None if not measured."""
    lacking: float | None = None
    """Volume of the link outside the pieces, relative to the link's volume; None if not measured."""


class Collision(Artifact):
    """Collision geometry of a body."""

    links: dict[str, Pieces]
    """Link -> pieces, object frame at joint positions 0."""


class Placement(Artifact):
    """Pose and scale of a body."""

    pose: Annotated[Pose, Frames("world", "object")]
    """T_world_object of the scaled body (root link); without a covariance if the method states none."""
    scale: float
    """Uniform factor from the mesh's units to metres."""
    scale_sigma: float | None = None
    """Standard deviation of the logarithm of `scale`; None if the method states none."""
    residual_m: float | None = None
    """Trimmed mean distance of the seen points to the placed surface [m]; None without depth."""
    overlap: float | None = None
    """Fraction of the seen points within 5 mm of the placed surface; None without depth."""
    method: str
    """Method that found it."""
    ambiguous: bool = False
    """Whether the rotation is undetermined: because of the shape's symmetry, of another equally good placement, or
    because no placement fits well."""
    asset_source: AssetSource = "rgb"
    """Source of the placed body; the placement itself may use all measurements."""


class Asset(Artifact):
    """A simulation-ready object, scaled to metres and placed."""

    body: Body
    """Links and joints, scaled."""
    physics: Physics
    """Masses and contact properties of the scaled body."""
    collision: Collision
    """Convex pieces, scaled."""
    pose: Annotated[Pose, Frames("world", "object")]
    """T_world_object, with the placement's covariance."""
    category: str
    """See `Element.category`."""
    cut: bool = False
    """See `Traits.cut`."""
    asset_source: AssetSource = "rgb"
    """Source of the asset."""
    scale: ScaleSource = "depth"
    """See `Support.scale`; if it is `unknown`, lengths and masses are not metric."""
    scale_sigma: float | None = None
    """Standard deviation of the log of all lengths; None if the placement states none."""
