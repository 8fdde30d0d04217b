"""reference.world: a reference world from its description."""

from __future__ import annotations

import itertools

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.world import Hinge, Lamp, Matter, Part, RobotStand, Thing, World
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Context, Fraction, Options, rule

from . import solids
from .objects import ThingOptions
from .room import RoomOptions, TableOptions, fixture


class CameraOptions(Options):
    """A pinhole camera and its pose."""

    width_px: PositiveInt = 1280
    """Image width [px]."""
    height_px: PositiveInt = 720
    """Image height [px]."""
    fx_px: PositiveFloat = 912.0
    """Focal length along x [px]."""
    fy_px: PositiveFloat = 912.0
    """Focal length along y [px]."""
    cx_px: NonNegativeFloat = 639.5
    """Principal point, x [px]."""
    cy_px: NonNegativeFloat = 359.5
    """Principal point, y [px]."""
    eye_m: tuple[float, float, float]
    """Optical centre in the world [m]."""
    target_m: tuple[float, float, float]
    """Point in the world that projects to the principal point [m]."""


class LampOptions(Options):
    """A directional light."""

    direction: tuple[float, float, float]
    """Direction of the light."""
    strength: Fraction
    """Diffuse intensity, 0..1."""
    shadow: bool = False
    """Whether it casts shadows."""


class StandOptions(Options):
    """Pose of the robot."""

    position_m: tuple[float, float, float]
    """Origin of the base in the world [m]."""
    yaw_deg: float = 0.0
    """Rotation about z [deg]."""
    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint -> position [deg]; omitted joints are at home."""


class WorldOptions(Options):
    """Options of reference.world: the world as data. z is up, the table's top is z = 0."""

    camera: CameraOptions
    """The camera."""
    table: TableOptions = TableOptions()
    """The table."""
    room: RoomOptions = RoomOptions()
    """Floor and wall."""
    objects: dict[str, ThingOptions]
    """Objects on the table, by name."""
    lamps: tuple[LampOptions, ...]
    """Lights."""
    ambient: Fraction = 0.4
    """Intensity of the ambient light, 0..1."""
    robot: StandOptions | None = None
    """Pose of the robot."""


@rule(version=1, packages=("numpy", "pillow", "manifold3d"))
def world(ctx: Context, *, options: WorldOptions) -> World:
    """Return the reference world: textured closed meshes [m], poses in its frame `reference`, lights, camera."""
    objects = {}
    for name, thing in options.objects.items():
        objects[name] = _thing(thing.parts(), thing.pose(), thing.matter(), thing.hinge())
        ctx.check(objects[name].surface.is_closed, f"the surface of `{name}` is open")
        _check_physics(ctx, name, objects[name])
    camera, pose = _camera(options.camera)
    _check_places(ctx, objects, options.table)
    _check_view(ctx, objects, camera, pose)
    fixtures = {name: fixture(name, part) for name, part in (options.table.parts() | options.room.parts()).items()}
    stand = None
    if options.robot is not None:
        joints = {name: float(np.radians(value)) for name, value in options.robot.joints_deg.items()}
        yaw = float(np.radians(options.robot.yaw_deg))
        stand = RobotStand(position=options.robot.position_m, yaw=yaw, joints=joints)
    ctx.say(f"{len(objects)} objects, {len(fixtures)} fixtures, {'a' if stand else 'no'} robot")
    return World(
        objects=objects,
        fixtures=fixtures,
        lamps=tuple(Lamp(**lamp.model_dump()) for lamp in options.lamps),
        ambient=options.ambient,
        stand=stand,
        camera=camera,
        camera_pose=Pose(parent="reference", child="camera", matrix=pose),
    )


def _thing(parts: dict[str, Part], pose: np.ndarray, matter: Matter | None = None, hinge: Hinge | None = None) -> Thing:
    surface = solids.union([part.mesh for part in parts.values()])
    place = Pose(parent="reference", child="thing", matrix=pose)
    return Thing(parts=parts, surface=surface, pose=place, matter=matter, hinge=hinge)


def _camera(options: CameraOptions) -> tuple[Camera, np.ndarray]:
    pose = cameras.look_at(np.array(options.eye_m), np.array(options.target_m))
    camera = Camera(
        width=options.width_px,
        height=options.height_px,
        fx=options.fx_px,
        fy=options.fy_px,
        cx=options.cx_px,
        cy=options.cy_px,
    )
    return camera, pose


def _check_physics(ctx: Context, name: str, thing: Thing) -> None:
    if thing.hinge is not None and thing.matter is not None:
        inside = thing.hinge.lower <= thing.hinge.position <= thing.hinge.upper
        limits = f"{np.degrees(thing.hinge.lower):g} to {np.degrees(thing.hinge.upper):g} deg"
        ctx.check(inside, f"`{name}` stands beyond its hinge's limits", limits=limits, hint="change `opening_deg`")
        lighter = 0 < thing.hinge.mass_kg < thing.matter.mass_kg
        ctx.check(lighter, f"the lid of `{name}` is heavier than the whole", hint="lower `lid_kg`")


def _posed(thing: Thing) -> Mesh:
    return solids.moved(thing.surface, thing.pose.matrix)


def _check_places(ctx: Context, objects: dict[str, Thing], table: TableOptions) -> None:
    low, high = table.bounds()
    posed = {name: _posed(thing) for name, thing in objects.items()}
    for name, mesh in posed.items():
        points = mesh.vertices
        inside = bool((points[:, :2] >= low).all() and (points[:, :2] <= high).all())
        ctx.check(inside, f"`{name}` does not stand on the table", hint=f"move `objects.{name}.at_m`")
        ctx.check(
            abs(points[:, 2].min()) < 1e-6, f"`{name}` does not touch the table", lowest=f"{points[:, 2].min():g} m"
        )
    for one, other in itertools.combinations(posed, 2):
        apart = solids.gap(posed[one], posed[other]) > 0
        ctx.check(apart, f"`{one}` and `{other}` run into each other", hint=f"move `objects.{other}.at_m`")


def _check_view(ctx: Context, objects: dict[str, Thing], camera: Camera, pose: np.ndarray) -> None:
    for name, thing in objects.items():
        points = transforms.apply(transforms.invert(pose), _posed(thing).vertices.astype(np.float64))
        ahead = bool((points[:, 2] > 0).all())
        pixels = cameras.project(points, camera.matrix()) if ahead else np.full((1, 2), -1.0)
        inside = ahead and bool((pixels >= 0).all() and (pixels <= [camera.width - 1, camera.height - 1]).all())
        ctx.check(inside, f"`{name}` is not wholly in the picture", hint=f"move `objects.{name}.at_m` or the camera")
