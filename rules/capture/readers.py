"""Readers of files of other programs, one for each type of artifact."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.cameras.image import Image, LabelImage
from dextera_build.artifacts.cameras.lens import Lens
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.mesh_repair import repaired
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.track import Track
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.errors import listing
from dextera_build.formats import calibration as calibration_files
from dextera_build.formats import lens as lens_files
from dextera_build.formats import mcap
from dextera_build.formats import mesh as mesh_files
from dextera_build.formats import point_cloud as point_cloud_files
from dextera_build.formats import rig as rig_files
from dextera_build.formats import splats as splats_files
from dextera_build.formats import track as track_files
from dextera_build.formats import trajectory as trajectory_files
from dextera_build.formats import views as views_files
from dextera_build.gaussians import splatting
from dextera_build.geometry.thumbnail import thumbnail
from dextera_build.rule import Context

from .pictures import counts, pixels

T = TypeVar("T", bound=Artifact)
Read = (
    Calibration
    | LabelImage
    | Lens
    | Mesh
    | Panorama
    | PointCloud
    | Rig
    | Splats
    | Stream
    | Track
    | Trajectory
    | Video
    | Views
)
"""Types that can be read."""

AHEAD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""T_world_camera of a camera that looks along x with z up."""
_FOLDER = "file"
"""Folder of the scratch space that holds only the input."""
_BEGINS = {
    b"glTF": ".glb",
    b"ply": ".ply",
    b"solid": ".stl",
    b"#usda": ".usda",
    b"PXR-USDC": ".usdc",
    b"PK\x03\x04": ".usdz",
}
"""First bytes of a format -> its suffix."""
_COLMAP = re.compile(rb"^\s*\d+\s+[A-Z_]+\s+\d+\s+\d+\s", re.MULTILINE)
"""A camera in a `cameras.txt`."""


class Given(NamedTuple):
    """The input of a reader."""

    ctx: Context
    source: File | Folder
    path: str
    """The file in a folder; "" if it holds only one that can be read."""
    frame: str
    """Frame of the result; "": as stated in the file."""

    def file(self, suffixes: Collection[str] = ()) -> tuple[File, str]:
        """The file and its name in the folder, "" for a single file.

        Args:
            suffixes: Suffixes of the files in a folder that can be read; none: all.
        """
        if isinstance(self.source, File):
            return self.source, ""
        names = sorted(name for name in self.source.files if not suffixes or Path(name).suffix.lower() in suffixes)
        chosen = [self.path] if self.path else names
        if len(chosen) != 1 or chosen[0] not in self.source.files:
            self.ctx.fail(
                f"the folder does not hold `{self.path}`"
                if self.path
                else f"the folder holds {len(names)} files that can be read",
                files=listing(names),
                hint="name one of them in `path`",
            )
        return File(data=self.source.files[chosen[0]]), chosen[0]

    def data(self) -> bytes:
        """The content of the file."""
        return self.file()[0].data

    def placed(self, suffixes: Collection[str], stem: str) -> Path:
        """The file, with a suffix of its format, in a folder that holds only the input."""
        found, name = self.file(suffixes)
        root = self.ctx.scratch / _FOLDER
        if isinstance(self.source, Folder):
            self.source.export(root, stem)
            return root / name
        path = root / f"{stem}{self._suffix(found.data, suffixes)}"
        found.place(path)
        return path

    def _suffix(self, data: bytes, suffixes: Collection[str]) -> str:
        triangles = int.from_bytes(data[80:84], "little")
        known = {magic: suffix for magic, suffix in _BEGINS.items() if suffix in suffixes}
        if ".stl" in suffixes and len(data) == 84 + 50 * triangles:  # a binary one may begin with anything
            return ".stl"
        found = next((suffix for magic, suffix in known.items() if data.startswith(magic)), None)
        if found is None and ".obj" in suffixes and re.search(rb"^v\s", data, re.MULTILINE):
            return ".obj"  # which has no mark
        if found is None:
            self.ctx.fail(
                "the format of the file is not known",
                begins=repr(data[:12]),
                known=listing(suffixes),
                hint="export it in one of the known formats",
            )
        return found


def mesh(given: Given, unit_m: float, up: Literal["x", "y", "z", "file"], *, repair: bool) -> Mesh:
    """All triangles of a file as one mesh with one texture, z up, in metres."""
    ctx, path = given.ctx, given.placed(mesh_files.LOADS, "mesh")
    axis = None if up == "file" else up
    made = mesh_files.load(path, metres_per_unit=unit_m, up=axis, within=ctx.scratch / _FOLDER)
    said = ", ".join(made.facts())
    if repair:
        made, report = repaired(made)
        ctx.check(
            report.open_edges == 0,
            f"the mesh stays open after the repair: {report.open_edges:,} edges",
            hint="close it in a modelling program, or leave out `repair`",
            changes=report,
        )
        said = f"{said}; {report}"
    ctx.metric("faces", len(made.faces))
    ctx.metric("closed", float(made.is_closed))
    ctx.preview(thumbnail([(made.vertices[made.faces], made.paint)]), "the mesh")
    ctx.say(said)
    return made


def panorama(given: Given, pose: Pose | None) -> Panorama:
    """An equirectangular picture, twice as wide as high, at a pose or at the origin with z up and x ahead."""
    ctx = given.ctx
    found = pixels(ctx, given.data(), "panorama", "RGB")
    height, width = found.shape[:2]
    if width != 2 * height:
        ctx.fail(
            "the picture is not twice as wide as high, so it does not show all directions",
            size=f"{width} x {height} px",
            hint="pad it with black to 360 x 180 degrees",
        )
    ctx.say(f"{width} x {height} px")
    ctx.preview(found, "panorama")
    origin = Pose(parent=given.frame or "world", child="camera", matrix=AHEAD)
    return Panorama(image=Image(pixels=found), pose=pose or origin)


def calibration(given: Given, camera_info: File | None) -> Calibration:
    """A hand-eye calibration, with the intrinsics of a ROS camera_info."""
    info = None if camera_info is None else camera_info.data
    return _said(given, calibration_files.parse(given.data(), "calibration.yaml", info))


def stream(given: Given, topics: Sequence[str]) -> Stream:
    """A recording with its index; messages stay in the file."""
    found = mcap.of(given.file((".mcap",))[0])
    known = {each.topic for each in found.channels if each.count}
    missing = [topic for topic in topics if topic not in known]
    if missing:
        given.ctx.fail(
            f"topic `{missing[0]}` was not recorded",
            topics=", ".join(sorted(known)) or "none",
            hint="record it, or leave it out of option `topics`",
        )
    given.ctx.metric("duration", found.duration_s(), "s")
    return _said(given, found)


def trajectory(given: Given, child: str) -> Trajectory:
    """Poses over time: lines of stamp [s], position [m] and quaternion x y z w."""
    found = trajectory_files.parse(given.data(), "trajectory.txt", parent=given.frame or None, child=child or None)
    given.ctx.metric("length", found.length_m(), "m")
    return _said(given, found)


def lens(given: Given, wanted: str) -> Lens:
    """A camera with integer pixel centres [px]; its lens must be of the wanted type."""
    data = given.data()
    name = "cameras.txt" if _COLMAP.search(data) else "camera_info.yaml"
    found = lens_files.parse(data, Path(name))
    if found.name() != wanted:
        given.ctx.fail(f"the lens is a {found.name()}, not a {wanted}", hint=f"write `type: {found.name()}`")
    return _said(given, found)


def _points(given: Given) -> PointCloud:
    """The points of a PLY file [m], with colours, normals and other properties."""
    found = point_cloud_files.load(given.placed((".ply",), "points"), frame=given.frame or None)
    given.ctx.metric("points", len(found.points))
    return _said(given, found)


def _splats(given: Given) -> Splats:
    """The Gaussians of a file, in the frame and unit of a PLY; USD is converted to z up and metres."""
    path = given.placed((".ply", ".usda", ".usdc", ".usd", ".usdz"), "splats")
    found = splats_files.load(path, frame=given.frame or None)
    given.ctx.metric("Gaussians", len(found.means))
    given.ctx.preview(splatting.preview(found.gaussians), "the Gaussians")
    return _said(given, found)


def _track(given: Given) -> Track:
    """Poses of an object: columns parent, child, stamp, x, y, z, qw, qx, qy, qz and status."""
    found = track_files.parse(given.data(), "track.csv")
    given.ctx.metric("found", found.status.count("tracked") / len(found.status), "fraction")
    return _said(given, found)


def _rig(given: Given) -> Rig:
    """Cameras of a Kalibr camchain; the frame `rig` is that of the IMU, or of the first camera."""
    return _said(given, rig_files.parse(given.data(), "camchain.yaml"))


def _video(given: Given) -> Video:
    """An encoded video with its index; frames stay in the file."""
    found = Video.of(given.file((".mp4", ".mkv", ".mov"))[0])
    given.ctx.metric("duration", float(found.stamps[-1] - found.stamps[0]), "s")
    return _said(given, found)


def _views(given: Given) -> Views:
    """Pictures of a COLMAP text model or a `transforms.json`, with poses in OpenCV axes."""
    ctx, folder = given.ctx, given.source
    if isinstance(folder, File):
        ctx.fail("views are a folder of pictures and their poses, this is a file", hint="give the folder")
    found = views_files.parse({path: File(data=data) for path, data in folder.files.items()})
    if not found.names:
        ctx.fail("no picture has a pose", here=listing(folder.files), hint="reconstruct the scene first")
    for number, name in enumerate(found.names):
        found.pixels(name)  # of the size that its camera states
        ctx.progress(number + 1, len(found.names), "pictures")
    if given.frame:
        points = found.points and found.points.model_copy(update={"frame": given.frame})
        found = found.model_copy(update={"frame": given.frame, "points": points})
    return _said(given, found)


def _labels(given: Given) -> LabelImage:
    """Ground-truth instance labels, for evaluation only: 0 is background, 1.. are instances."""
    found, name = given.file((".png",))
    values = counts(given.ctx, found.data, name or "labels")
    given.ctx.say(f"{len(np.unique(values[values > 0]))} instances")
    return LabelImage(labels=values.astype(np.int32))


def _said(given: Given, found: T) -> T:
    given.ctx.say(", ".join(found.facts()))
    return found


READERS: dict[str, Callable[[Given], Read]] = {
    "LabelImage": _labels,
    "PointCloud": _points,
    "Rig": _rig,
    "Splats": _splats,
    "Track": _track,
    "Video": _video,
    "Views": _views,
}
"""Type -> the reader of its files, which needs no options."""
