"""Options of simulate.imported_robot: files, and the roles that files do not state."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.rule import Options

from .limbs import GripOptions, LimbOptions, Quaternion, Vector
from .robot import FrameOptions


class PartOptions(Options):
    """One file, and where its robot is fixed."""

    file: str
    """Path of the URDF or MJCF in `files`."""
    root: str = ""
    """Link whose subtree is used; empty: the only one without a parent; `world`: everything in an MJCF."""
    prefix: str = ""
    """Begins the names of its links and joints."""
    on: str = ""
    """Link of an earlier part, with prefix, on which it is fixed; empty for the first part."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the root on that link [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the root on that link, w x y z."""
    drawn: tuple[str, ...] = ()
    """Meshes that touch and are seen too; where a link has geometry that is only seen, what touches is not drawn."""


class FollowOptions(Options):
    """A joint that a mechanism couples to another, where the file does not say so."""

    leader: str
    """The joint that it follows, with prefix."""
    ratio: float
    """Motion per motion of the leader."""
    offset_rad: float = 0.0
    """Position with the leader at 0 [rad, of sliding joints m]."""


class JointNumbers(Options):
    """What a file does not say about a joint, or says otherwise; a sliding joint has m and N."""

    lower_rad: float | None = None
    """Lower limit [rad]."""
    upper_rad: float | None = None
    """Upper limit [rad]."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed [rad/s]."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque [N m]."""
    stiffness_nm_rad: NonNegativeFloat | None = None
    """Gain of the position actuator [N m/rad]."""
    damping_nms_rad: NonNegativeFloat | None = None
    """Damping of the position actuator [N m s/rad]."""


class ImportedRobotOptions(Options):
    """Options of simulate.imported_robot: the roles that files do not state."""

    name: str = "robot"
    """Name of the model."""
    source: str = "the project's files"
    """Source of kinematics, masses and limits."""
    parts: tuple[PartOptions, ...] = ()
    """Files, the arm's first."""
    hand: tuple[str, ...] = ()
    """Links at which the hand begins, with prefix; they and all links beyond are the hand, all others the arm."""
    active: tuple[str, ...] = ()
    """Joints that are driven, with prefix, `*` for any text; empty: all that move. Others are fixed at home."""
    frames: dict[str, FrameOptions] = Field(default_factory=dict)
    """Role -> frame on a link or a site: `flange`, `palm`, `tip_index`, ..."""
    home_rad: dict[str, float] = Field(default_factory=dict)
    """Joint -> home position [rad, m]; others are at the file's first keyframe, or at 0."""
    joints: dict[str, JointNumbers] = Field(default_factory=dict)
    """Joint -> numbers that count before those of the file."""
    followers: dict[str, FollowOptions] = Field(default_factory=dict)
    """Joint -> the joint that it follows, in addition to what the files couple."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed of joints whose file states none [rad/s]."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque of joints whose file states none [N m]."""
    grips: dict[str, GripOptions] = Field(default_factory=dict)
    """Name -> grip of the only hand."""
    limbs: dict[str, LimbOptions] = Field(default_factory=dict)
    """Limb -> what the roles of `frames` do not say of it."""
    apart: tuple[tuple[str, str], ...] = ()
    """Pairs of links excluded from contact, in addition to neighbours and to those that touch at home."""
