"""One way to show each artifact type: `show(artifact, server, name)` adds it to a viser scene under `name`."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact, Collection
from dextera_build.artifacts.cameras.camera import Camera, Capture, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Asset, Body, Collision, Shape, Support
from dextera_build.artifacts.objects.view import Instance, ObjectView, Segmentation
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.scenes.scene_description import Box, Geom, SceneDescription
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import UsageError
from dextera_build.gaussians import arrays
from dextera_build.geometry import cameras, convex, kinematics, quaternions, transforms
from dextera_build.view.figure import add_textured

PIECE_COLOURS = ((230, 85, 60), (60, 140, 220), (90, 180, 90), (235, 170, 50), (150, 105, 200), (90, 190, 190))
MOST_POINTS = 100_000


@singledispatch
def show(artifact: Artifact, server: Any, name: str) -> Any:
    """Add `artifact` to the viser `server` as scene node `name` and return its handle.

    Raises:
        UsageError: Artifacts of this type cannot be shown.
    """
    kinds = sorted(kind.__name__ for kind in show.registry if kind not in (object, Artifact))
    raise UsageError(f"a {artifact.name()} has no shape to view", code="DXB-U320", facts={"shapes": ", ".join(kinds)})


@show.register
def _(mesh: Mesh, server: Any, name: str) -> Any:
    """A mesh with its texture, seen from both sides."""
    if mesh.texture is None or mesh.uv is None:
        colour = tuple(round(255 * part) for part in mesh.colour)
        return server.scene.add_mesh_simple(name, mesh.vertices, mesh.faces, color=colour, side="double")
    # The texture already contains the light of the photograph.
    uv, pixels = mesh.uv.reshape(-1, 2), mesh.texture.pixels
    return add_textured(server, name, mesh.vertices, mesh.faces, uv, pixels, glows=True)


@show.register
def _(hull: Hull, server: Any, name: str) -> Any:
    """A convex piece."""
    return add_piece(server, name, hull, PIECE_COLOURS[0])


@show.register
def _(shape: Shape, server: Any, name: str) -> Any:
    """A completed object at its first guess of a pose."""
    frame = add_frame(server, name, _place(shape.pose))
    show(shape.mesh, server, f"{name}/mesh")
    return frame


@show.register
def _(body: Body, server: Any, name: str) -> Any:
    """An articulated object in its photographed pose."""
    frame = add_frame(server, name, _place(body.pose))
    for link, pose in kinematics.link_poses(body).items():
        add_frame(server, f"{name}/{link}", pose)
        show(body.links[link].mesh, server, f"{name}/{link}/visual")
    return frame


@show.register
def _(collision: Collision, server: Any, name: str) -> Any:
    """All pieces of all links, one colour after the other."""
    frame = add_frame(server, name, np.eye(4))
    for link, pieces in collision.links.items():
        for number, hull in enumerate(pieces.hulls):
            add_piece(server, f"{name}/{link}/piece_{number}", hull, PIECE_COLOURS[number % len(PIECE_COLOURS)])
    return frame


@show.register
def _(asset: Asset, server: Any, name: str) -> Any:
    """A placed object in its photographed pose."""
    return show(asset.body.model_copy(update={"pose": asset.pose}), server, name)


@show.register
def _(background: Background, server: Any, name: str) -> Any:
    """The static surface and its collision boxes."""
    frame = add_frame(server, name, np.eye(4))
    show(background.mesh, server, f"{name}/surface")
    if background.invented is not None:
        show(background.invented, server, f"{name}/invented")
    for box in background.boxes:
        turn = np.array([np.cos(box.yaw / 2), 0.0, 0.0, np.sin(box.yaw / 2)])
        server.scene.add_box(
            f"{name}/boxes/{box.name}",
            color=PIECE_COLOURS[1],
            dimensions=tuple(2 * half for half in box.half_size),
            opacity=0.3,
            wxyz=turn,
            position=box.centre,
            visible=False,
        )
    return frame


@show.register
def _(scene: SceneDescription, server: Any, name: str) -> Any:
    """All bodies in the home keyframe; shapes for collision are hidden."""
    frame = add_frame(server, name, np.eye(4))
    for geom in scene.static:
        add_geom(server, f"{name}/static/{geom.label}", geom)
    for thing in scene.objects:
        for part, pose in thing.world_poses().items():
            body = thing.links[part]
            add_frame(server, f"{name}/{body.label}", pose)
            for geom in body.geoms:
                add_geom(server, f"{name}/{body.label}/{geom.label}", geom)
    return frame


@show.register
def _(support: Support, server: Any, name: str) -> Any:
    """The outline of the seen support, on z = 0."""
    corners = np.concatenate([support.polygon, np.zeros((len(support.polygon), 1))], axis=1)
    segments = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return server.scene.add_line_segments(name, segments, colors=(46, 125, 70), thickness=2.0, thickness_units="screen")


@show.register
def _(capture: Capture, server: Any, name: str) -> Any:
    """The coloured points of a capture, in the camera frame turned upright (z up); the photograph without depth."""
    if capture.measured is None:
        return show(capture.photograph, server, name)
    depth = capture.measured.depth.depth
    points = cameras.backproject(depth, capture.photograph.camera.matrix())
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return add_points(server, name, points @ upright.T, capture.photograph.rgb.pixels, depth > 0)


@show.register
def _(photograph: Photograph, server: Any, name: str) -> Any:
    """The picture."""
    return show(photograph.rgb, server, name)


@show.register
def _(view: ObjectView, server: Any, name: str) -> Any:
    """The crop."""
    return show(view.rgb, server, name)


@show.register
def _(instance: Instance, server: Any, name: str) -> Any:
    """The seen points of one object in the world frame; its crop without depth."""
    view, measured = instance.view, instance.measured
    if measured is None:
        return show(view, server, name)
    depth = measured.depth.depth
    points = cameras.backproject(depth, view.camera.matrix())
    world = transforms.apply(measured.camera_pose.matrix, points)
    return add_points(server, name, world, view.rgb.pixels, view.mask & (depth > 0))


@show.register
def _(segmentation: Segmentation, server: Any, name: str) -> Any:
    """The seen points of every object."""
    frame = add_frame(server, name, np.eye(4))
    for label, instance in segmentation.items.items():
        show(instance, server, f"{name}/{label}")
    return frame


@show.register
def _(cloud: PointCloud, server: Any, name: str) -> Any:
    """The points, in one colour if they have none."""
    grey = np.full(cloud.points.shape, 110, np.uint8)
    colours = grey if cloud.colours is None else cloud.colours
    return add_points(server, name, cloud.points, colours, np.ones(len(cloud.points), bool))


@show.register
def _(splats: Splats, server: Any, name: str) -> Any:
    """The Gaussians, in the colours that they show towards the start of the view, far above."""
    made = splats.gaussians
    colours = arrays.colours(made, np.array([0.0, 0.0, 1e6])).clip(0, 1).astype(np.float32)
    return server.scene.add_gaussian_splats(
        name,
        centers=splats.means,
        covariances=arrays.covariances(made).astype(np.float32),
        rgbs=colours,
        opacities=splats.opacities[:, None],
    )


@show.register
def _(room: Room, server: Any, name: str) -> Any:
    """The Gaussians of the static scene."""
    return show(room.splats, server, name)


@show.register
def _(collection: Collection, server: Any, name: str) -> Any:  # type: ignore[type-arg]
    """Every item under its label."""
    frame = add_frame(server, name, np.eye(4))
    for label, item in collection.items.items():
        show(item, server, f"{name}/{label}")
    return frame


@show.register
def _(image: Image, server: Any, name: str) -> Any:
    """A picture that stands upright, one metre wide."""
    height, width = image.pixels.shape[:2]
    upright = quaternions.from_matrix(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]))
    return server.scene.add_image(name, image.pixels, 1.0, height / width, wxyz=upright, position=(0.0, 0.0, 0.5))


@show.register
def _(pose: Pose, server: Any, name: str) -> Any:
    """A pair of axes."""
    return add_frame(server, name, pose.matrix, axes=0.1)


def _place(pose: Pose | None) -> np.ndarray:
    return np.eye(4) if pose is None else pose.matrix


def add_frame(server: Any, name: str, pose: np.ndarray, axes: float = 0.0) -> Any:
    """A node at the (4, 4) `pose`; its axes are drawn `axes` [m] long, or hidden at 0."""
    return server.scene.add_frame(
        name,
        wxyz=quaternions.from_matrix(pose[:3, :3]),
        position=pose[:3, 3],
        show_axes=axes > 0,
        axes_length=axes or 0.05,
        axes_radius=(axes or 0.05) / 25,
    )


def add_piece(server: Any, name: str, hull: Hull, colour: tuple[int, int, int], *, visible: bool = True) -> Any:
    """A see-through convex piece."""
    vertices, faces = convex.surface(hull.vertices)
    return server.scene.add_mesh_simple(
        name, vertices, faces, color=colour, opacity=0.5, flat_shading=True, visible=visible
    )


def add_geom(server: Any, name: str, geom: Geom) -> Any:
    """A shape of a scene in the frame of its body."""
    if isinstance(geom.shape, Mesh):
        return show(geom.shape.model_copy(update={"vertices": geom.vertices().astype(np.float32)}), server, name)
    colour = PIECE_COLOURS[1 if isinstance(geom.shape, Box) else 0]
    return add_piece(server, name, Hull(vertices=geom.vertices().astype(np.float32)), colour, visible=False)


def add_points(server: Any, name: str, points: np.ndarray, colours: np.ndarray, where: np.ndarray) -> Any:
    """Points (..., 3) [m] with colours (..., 3) uint8 where `where` (...) holds, thinned evenly."""
    chosen = np.flatnonzero(where)
    chosen = chosen[:: max(1, -(-len(chosen) // MOST_POINTS))]
    flat, paint = points.reshape(-1, 3)[chosen], colours.reshape(-1, 3)[chosen]
    return server.scene.add_point_cloud(name, flat.astype(np.float32), paint, point_size=0.002, point_shape="circle")


def add_camera(server: Any, name: str, camera: Camera, world_from_camera: np.ndarray) -> Any:
    """The camera's frustum at T_world_camera (4, 4), 5 cm deep."""
    return server.scene.add_camera_frustum(
        name,
        fov=float(2 * np.arctan2(camera.height / 2, camera.fy)),
        aspect=camera.width / camera.height,
        scale=0.05,
        thickness=0.001,
        wxyz=quaternions.from_matrix(world_from_camera[:3, :3]),
        position=world_from_camera[:3, 3],
    )
