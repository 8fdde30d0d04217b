"""Options of simulate.imported_robot: files, and the roles that files do not contain."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.robots.robot import ACCELERATION
from dextera_build.rule import Options

from .limbs import GripOptions, LimbOptions, Quaternion, Vector
from .operated import HandOptions
from .robot import FrameOptions


class PartOptions(Options):
    """One file, and the mounting of its robot."""

    file: str
    """Path of the URDF or MJCF in `files`."""
    root: str = ""
    """Link whose subtree is used; empty: the only one without a parent; `world`: everything in an MJCF."""
    prefix: str = ""
    """Prefix of the names of its links and joints."""
    on: str = ""
    """Link of an earlier part, with prefix, that it is mounted on; empty for the first part."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the root on that link [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the root on that link, w x y z."""
    repair_inertias: bool = False
    """Replace moments of inertia of a URDF that no rigid body has by the nearest ones that a body can have."""
    solid: tuple[str, ...] = ()
    """Links without collision geometry, as the file calls them, whose visual geometry also touches."""
    drawn: tuple[str, ...] = ()
    """Collision meshes that are also visible; on links with separate visual geometry, collision geometry is not
    drawn."""


class AttachOptions(Options):
    """A hand of its own file on a frame of the arm; a short form of a second part."""

    hand: str
    """Path of the hand's URDF or MJCF in `files`."""
    at: str = "flange"
    """Role in `frames`, or link or site of the arm, on which the hand's root stands."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the hand's root in that frame [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the hand's root in that frame, w x y z."""
    prefix: str = "hand_"
    """Prefix of the names of its links and joints."""
    repair_inertias: bool = False
    """Replace moments of inertia of a URDF that no rigid body has by the nearest ones that a body can have."""
    solid: tuple[str, ...] = ()
    """Links without collision geometry, as the file calls them, whose visual geometry also touches."""


class FollowOptions(Options):
    """A mechanically coupled joint, if the coupling is not in the file."""

    leader: str
    """The joint that it follows, with prefix."""
    ratio: float
    """Motion per motion of the leader."""
    offset_rad: float = 0.0
    """Position with the leader at 0 [rad, of prismatic joints m]."""


class JointNumbers(Options):
    """Properties of a joint that are missing in the file, or override it; a prismatic joint has m and N."""

    lower_rad: float | None = None
    """Lower limit [rad]."""
    upper_rad: float | None = None
    """Upper limit [rad]."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed [rad/s]."""
    acceleration_rad_s2: PositiveFloat | None = None
    """Maximum acceleration of targets [rad/s^2]."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque [N m]."""
    stiffness_nm_rad: NonNegativeFloat | None = None
    """Gain of the position actuator [N m/rad]."""
    damping_nms_rad: NonNegativeFloat | None = None
    """Damping of the position actuator [N m s/rad]."""


class ImportedRobotOptions(Options):
    """Options of simulate.imported_robot: the roles that files do not contain."""

    name: str = "robot"
    """Name of the model."""
    source: str = "the project's files"
    """Source of kinematics, masses and limits."""
    parts: tuple[PartOptions, ...] = ()
    """Files, the arm's file first."""
    attach: AttachOptions | None = None
    """A hand of its own file; `hand` then begins at its root if left out."""
    hand: tuple[str, ...] = ()
    """Links at which the hand begins, with prefix; they and all their descendants are the hand, all others the arm."""
    active: tuple[str, ...] = ()
    """Actuated joints, with prefix, `*` for any text; empty: all movable joints. Others are fixed at home."""
    frames: dict[str, FrameOptions] = Field(default_factory=dict)
    """Role -> frame on a link or a site: `flange`, `palm`, `tip_index`, ..."""
    home_rad: dict[str, float] = Field(default_factory=dict)
    """Joint -> home position [rad, m]; others use the file's first keyframe, or 0."""
    joints: dict[str, JointNumbers] = Field(default_factory=dict)
    """Joint -> properties that override those of the file."""
    followers: dict[str, FollowOptions] = Field(default_factory=dict)
    """Joint -> the joint that it follows, in addition to the couplings in the files."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed of joints without one in the file [rad/s]."""
    acceleration_rad_s2: PositiveFloat = ACCELERATION
    """Maximum acceleration of the targets of joints that state none, which files do not have [rad/s^2]; as of
    `simulate.robot`."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque of joints without one in the file [N m]."""
    grips: dict[str, GripOptions] = Field(default_factory=dict)
    """Name -> grip of the only hand."""
    limbs: dict[str, LimbOptions] = Field(default_factory=dict)
    """Limb -> properties that do not follow from the roles of `frames`."""
    hands: dict[str, HandOptions] = Field(default_factory=dict)
    """Limb -> how an operator's hand maps to its hand."""
    apart: tuple[tuple[str, str], ...] = ()
    """Pairs of links excluded from contact, in addition to neighbours and links that touch at home."""
