"""The scene of the viewer as a recording for Rerun (`.rrd`): surfaces, their motion, and cameras with pictures."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.errors import MachineError, install_extra
from dextera_build.view import recorded

TIME = "time"
"""Name of the timeline, in seconds from the start."""
QUALITY = 92
"""Of JPEG."""
ABOVE_M = 0.15
"""Height of Rerun's first view above the viewer's, where a camera's own picture would hide the scene [m]."""
Begin: TypeAlias = tuple[Sequence[float], Sequence[float]]
"""Place from which the viewer looks, and a place at which it looks, (3,) each in the world [m]."""
_TINY_M = 1e-4
_AXES = np.array([[255, 60, 60], [60, 200, 60], [60, 90, 255]], np.uint8)


@dataclass(frozen=True)
class Eye:
    """A camera that stands still, and what it saw."""

    name: str
    """Name in the recording."""
    camera: Camera
    """Intrinsics at the size of the pictures [px]."""
    world_from_camera: np.ndarray
    """T_world_camera (4, 4), OpenCV axes [m]."""
    pictures: Iterable[np.ndarray]
    """(H, W, 3) uint8 sRGB, one per step; one alone is shown all the time."""
    rate_hz: float = 0.0
    """Steps per second; 0 of one picture alone."""


def check() -> None:
    """Refuse to write without Rerun.

    Raises:
        MachineError: It is not installed.
    """
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise MachineError(
            "recordings for Rerun need rerun-sdk, which is not installed", code="DXB-E320", hint=install_extra("rerun")
        ) from None


def write(data: bytes, path: Path, name: str, begin: Begin, eyes: Sequence[Eye] = ()) -> list[str]:
    """Write `path`, and return what it lacks: kinds of nodes that are not written.

    Frames are those of the viewer: z up, metres. Cameras are `/cameras/NAME`.

    Args:
        data: A recording of viser.
        path: The file.
        name: What is shown, `task/close_laptop:episodes`.
        begin: Where the viewer opens.
        eyes: Cameras with pictures.
    """
    import rerun as rr

    out = rr.RecordingStream(re.sub(r"[^\w.-]+", "-", name), recording_id=name)
    out.disable_timeline("log_time")
    out.disable_timeline("log_tick")
    nodes = recorded.nodes(data)
    moves = any(len(node.poses) > 1 for node in nodes.values()) or any(eye.rate_hz for eye in eyes)
    out.save(path, default_blueprint=_layout(begin, eyes, moves=moves))
    out.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    lacks = set()
    for address, node in nodes.items():
        entity = [part for part in address.split("/") if part]
        shape = _shape(rr, node)
        if shape is None:
            lacks.add(node.kind.removesuffix("Message"))
            continue
        _move(rr, out, entity, node)
        if shape:
            out.log(entity, *shape, static=True)
    for eye in eyes:
        _look(rr, out, eye)
    out.flush()
    out.disconnect()
    return sorted(lacks)


def _layout(begin: Begin, eyes: Sequence[Eye], *, moves: bool) -> Any:
    """The views that Rerun opens: the scene, from where the viewer opens, and a picture per camera."""
    import rerun.blueprint as rrb

    position, target = np.array(begin, np.float64) + np.array([0.0, 0.0, ABOVE_M])
    controls = rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0))
    views = [rrb.Spatial3DView(origin="/", name="scene", eye_controls=controls, line_grid=False)]
    views += [rrb.Spatial2DView(origin=f"/cameras/{eye.name}", name=eye.name) for eye in eyes]
    time = rrb.TimePanel(timeline=TIME) if moves else rrb.TimePanel(state="hidden")
    return rrb.Blueprint(rrb.Horizontal(*views), time, collapse_panels=True)


def _move(rr: Any, out: Any, entity: list[str], node: recorded.Node) -> None:
    """A pose that never changes has no time."""
    poses = dict(list(node.poses.items())[-1:]) if len(node.poses) == 1 else node.poses
    for seconds, (position, (w, x, y, z)) in poses.items():
        place = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
        out.set_time(TIME, duration=seconds)
        out.log(entity, place, static=len(poses) == 1)


def _look(rr: Any, out: Any, eye: Eye) -> None:
    entity, lens, pose = ["cameras", eye.name], eye.camera, eye.world_from_camera
    out.log(entity, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    matrix = lens.matrix() + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # Rerun's origin is a corner of a pixel
    size = {"width": lens.width, "height": lens.height}
    flat = rr.Pinhole(image_from_camera=matrix, **size, camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.1)
    out.log(entity, flat, static=True)
    for step, pixels in enumerate(eye.pictures):
        out.set_time(TIME, duration=step / (eye.rate_hz or 1.0))
        out.log([*entity, "picture"], rr.Image(pixels).compress(QUALITY), static=not eye.rate_hz)


def _shape(rr: Any, node: recorded.Node) -> list[Any] | None:
    """What is drawn in a node's frame; None if its kind is not written."""
    props = node.props
    match node.kind:
        case "FrameMessage":
            return [_axes(rr, props["axes_length"])] if props["show_axes"] else []
        case "MeshMessage":
            opaque = 255 if props["opacity"] is None else round(255 * props["opacity"])
            corners, faces = props["vertices"].reshape(-1, 3) * _scale(props), props["faces"].reshape(-1, 3)
            return [_lit(rr, corners, faces, (*props["color"], opaque))]
        case "GlbMessage":
            return [_textured(rr, props["glb_data"], _scale(props))]
        case "PointCloudMessage":
            colours = props["colors"].reshape(-1, 3)
            places = props["points"].astype(np.float32).reshape(-1, 3) * _scale(props)
            return [rr.Points3D(places, colors=colours, radii=props["point_size"] / 2)]
        case "LineSegmentsMessage":
            colours = props["colors"].reshape(-1, 6)[:, :3]
            return [rr.LineStrips3D(props["points"].reshape(-1, 2, 3), colors=colours)]
        case "BoxMessage":
            half = np.array(props["dimensions"]) / 2 * _scale(props)
            return [rr.Boxes3D(half_sizes=[half], colors=[props["color"]])]
        case "LabelMessage":
            return [rr.Points3D([[0, 0, 0]], radii=_TINY_M, labels=[props["text"]], show_labels=True)]
        case "CameraFrustumMessage":
            return []  # cameras are written with their pictures
    return None


def _scale(props: dict[str, Any]) -> np.ndarray:
    return np.asarray(props["scale"], np.float32)


def _axes(rr: Any, length: float) -> Any:
    return rr.Arrows3D(vectors=length * np.eye(3), colors=_AXES)


def _lit(rr: Any, corners: np.ndarray, faces: np.ndarray, colour: tuple[int, ...]) -> Any:
    """A surface of one colour, which Rerun's light models: one normal per triangle."""
    triangles = corners[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
    return rr.Mesh3D(
        vertex_positions=triangles.reshape(-1, 3),
        triangle_indices=np.arange(3 * len(faces)).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0),
        albedo_factor=colour,
    )


def _textured(rr: Any, glb: bytes, scale: np.ndarray) -> Any:
    """A surface with its texture. It has no normals, so that Rerun shows the colours as they are."""
    import trimesh

    mesh = trimesh.load(io.BytesIO(glb), file_type="glb", force="mesh", process=False)
    look = mesh.visual.material
    texture = look.emissiveTexture if look.emissiveTexture is not None else look.baseColorTexture
    uv = np.asarray(mesh.visual.uv, np.float32) * [1, -1] + [0, 1]  # Rerun's v points down
    return rr.Mesh3D(
        vertex_positions=np.asarray(mesh.vertices, np.float32) * scale,
        triangle_indices=mesh.faces,
        vertex_texcoords=uv,
        albedo_texture=np.asarray(texture.convert("RGB")),
    )
