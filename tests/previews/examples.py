"""An example of every artifact type that has a picture of its own, and a sheet of these pictures for the docs.

`python -m tests.previews.examples [FILE.jpg]` writes the sheet.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.objects.view import InstanceMap, ObjectView
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.track import Track
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.formats import mcap
from dextera_build.formats import video as video_files
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import flat
from dextera_build.geometry import cameras
from tests import factories, hand_streams, object_views, tabletops, twins

SHEET = Path(__file__).parents[2] / "dextera_build" / "docs" / "images" / "previews.jpg"
_TILE, _LABEL, _COLUMNS = (312, 200), 24, 5


@cache
def table(angle: float = -1.57) -> tabletops.Tabletop:
    """Four things on a table, seen from this angle [rad] around it."""
    things = (
        (tabletops.box(0.12, 0.07, 0.16, (0.85, 0.7, 0.2)), factories.pose(-0.2, 0.05, 0.0, 0.5)),
        (tabletops.bowl((0.55, 0.6, 0.65)), factories.pose(0.0, -0.12)),
        (tabletops.cylinder(0.035, 0.18, (0.75, 0.2, 0.2)), factories.pose(0.2, 0.1)),
        (mug(), factories.pose(0.05, 0.16, 0.0, -0.6)),
    )
    eye = factories.look_at((0.7 * np.cos(angle), 0.7 * np.sin(angle), 0.5), (0.0, 0.02, 0.03))
    return tabletops.tabletop(*things, eye=eye, wall=True, lens=tabletops.FINE)


def mug() -> Artifact:
    """A blue mug."""
    return object_views.mesh(object_views.mug()).model_copy(update={"colour": (0.2, 0.35, 0.8)})


def pixels() -> np.ndarray:
    """The photograph of `table`, (H, W, 3) uint8."""
    return table().capture.photograph.rgb.pixels


def view() -> ObjectView:
    """The carton of `table`."""
    part = np.s_[100:280, 90:340]
    shown = np.ascontiguousarray(pixels()[part])
    return ObjectView(
        rgb=Image(pixels=shown),
        mask=np.ascontiguousarray(table().labels.labels[part] == 1),
        occluder=np.zeros(shown.shape[:2], bool),
        camera=tabletops.FINE.crop(90, 100, 250, 180),
        phrase="yellow carton",
    )


def cloud() -> PointCloud:
    """Every third measured pixel of `table`, in the world."""
    depth = table().capture.measured.depth.depth[::3, ::3].astype(np.float64)  # type: ignore[union-attr]
    rays = cameras.rays(tabletops.FINE.height, tabletops.FINE.width, tabletops.FINE.matrix())[::3, ::3]
    seen = (depth > 0) & (depth < 1.2)  # the things and the table, not the wall
    eye = table().world_from_camera
    points = (rays[seen] * depth[seen][:, None]) @ eye[:3, :3].T + eye[:3, 3]
    return PointCloud(points=points.astype(np.float32), colours=pixels()[::3, ::3][seen], frame="world")


def splats() -> Splats:
    """A Gaussian for each point."""
    points = cloud()
    assert points.colours is not None
    count = len(points.points)
    made = Gaussians(
        points.points.astype(np.float64),
        np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        np.full((count, 3), 0.003),
        np.full(count, 0.9),
        flat(points.colours / 255.0),
    )
    return Splats.of(made, "world")


def rig() -> Rig:
    """Two cameras side by side and one above, turned inwards."""
    places = {"left": (-0.1, 0.0, 0.0), "right": (0.1, 0.0, 0.0), "top": (0.0, -0.3, 0.2)}
    poses = {}
    for label, place in places.items():
        yaw = -2.0 * place[0]
        turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, place
        poses[label] = Pose(parent="rig", child=label, matrix=matrix)
    return Rig(cameras=dict.fromkeys(places, tabletops.FINE), poses=poses)


def views() -> Views:
    """`table` from four sides."""
    angles = (-2.2, -1.57, -0.9, 0.1)
    seen = [table(angle) for angle in angles]
    names = tuple(f"{number}.png" for number in range(len(angles)))
    return Views(
        images={name: encoded(each.capture.photograph.rgb.pixels) for name, each in zip(names, seen, strict=True)},
        names=names,
        camera=("camera",) * len(angles),
        cameras={"camera": tabletops.FINE},
        poses=np.array([each.world_from_camera for each in seen]),
        points=cloud(),
    )


def panorama() -> Panorama:
    """The photograph where it looks, a room of three colours elsewhere."""
    lens = Equirectangular(width=640, height=320)
    rows, columns = np.indices((320, 640))
    ways = lens.unproject(np.stack([columns, rows], -1).reshape(-1, 2).astype(np.float64)).reshape(320, 640, 3)
    level = ways[..., 1:2]
    room = np.where(level > 0.35, (120, 110, 100), np.where(level < -0.35, (225, 225, 220), (190, 185, 175)))
    ahead = ways[..., 2] > 0.2
    spots = tabletops.FINE.matrix() @ np.where(ahead[..., None], ways, (0.0, 0.0, 1.0)).reshape(-1, 3).T
    at = np.rint(spots[:2] / spots[2]).astype(int).reshape(2, 320, 640)
    seen = ahead & (at[0] >= 0) & (at[0] < 640) & (at[1] >= 0) & (at[1] < 480)
    shown = room.astype(np.uint8)
    shown[seen] = pixels()[at[1][seen], at[0][seen]]
    return Panorama(image=Image(pixels=shown), pose=factories.placed(np.eye(4), "camera"), seen=seen)


def orbit() -> np.ndarray:
    """Poses (60, 7) of a hand that reaches for something: position [m], quaternion w x y z."""
    t = np.linspace(0, 1, 60)
    turn = 0.8 * t
    zero = np.zeros(60)
    place = np.stack([0.4 * t, 0.15 * np.sin(6 * t), 0.3 - 0.2 * t + 0.1 * t**2], axis=1)
    return np.concatenate([place, np.stack([np.cos(turn / 2), zero, zero, np.sin(turn / 2)], 1)], axis=1)


def trajectory() -> Trajectory:
    """The hand's path."""
    return Trajectory(parent="world", child="hand", stamps=np.arange(60) / 30.0, poses=orbit())


def track() -> Track:
    """An object that is lost for a while."""
    status = ("tracked",) * 30 + ("predicted",) * 6 + ("lost",) * 8 + ("tracked",) * 16
    poses = orbit()
    poses[[word == "lost" for word in status]] = np.nan
    return Track(parent="world", child="mug", stamps=np.arange(60) / 30.0, poses=poses, status=status)


def calibration() -> Calibration:
    """A camera beside a robot, from twelve views of a board."""
    random = np.random.default_rng(3)
    spread = np.diag([2.0, 2.0, 4.0, 1.0, 1.0, 1.0]) * 1e-6
    eye = factories.look_at((0.9, -0.4, 0.8), (0.3, 0.0, 0.2))
    return Calibration(
        mount="eye_on_base",
        pose=Pose(parent="base", child="camera", matrix=eye, covariance=spread),
        camera=tabletops.FINE,
        method="Park",
        board=Board(kind="charuco", columns=9, rows=6, square_m=0.03, marker_m=0.022),
        residuals=random.gamma(4.0, [[0.0005, 0.0004]], (12, 2)),
        leave_one_out=random.gamma(5.0, [[0.0005, 0.0004]], (12, 2)),
        reprojection_px=random.gamma(4.0, 0.06, 12),
    )


def moving() -> Iterator[np.ndarray]:
    """Frames (240, 320, 3) of a camera that moves over `table`."""
    for number in range(24):
        yield np.ascontiguousarray(pixels()[100:340, 60 + 8 * number : 380 + 8 * number])


def video() -> Video:
    """`moving` as a file, which is read into memory."""
    with tempfile.TemporaryDirectory() as folder:
        made = video_files.write(Path(folder, "a.mp4"), moving(), video_files.encoder(320, 240, 12.0))
        return made.model_copy(update={"file": type(made.file)(data=made.file.data)})


def rgbd() -> RgbdVideo:
    """Colour and depth of a camera that moves over `table`."""
    seen = table().capture
    assert seen.measured is not None
    depth = np.minimum(seen.measured.depth.depth, 2.0)
    frames = [
        RgbdFrame(number / 12.0, rgb, np.ascontiguousarray(depth[100:340, 60 + 8 * number : 380 + 8 * number]))
        for number, rgb in enumerate(moving())
    ]
    with tempfile.TemporaryDirectory() as folder:
        made = RgbdVideo.write(Path(folder, "a.zip"), tabletops.FINE.crop(60, 100, 320, 240), frames)
        return made.model_copy(update={"file": type(made.file)(data=made.file.data)})


def masks() -> MaskTrack:
    """The things in the frames of `moving`."""
    labels = table().labels.labels.astype(np.uint8)
    maps = [np.ascontiguousarray(labels[100:340, 60 + 8 * number : 380 + 8 * number]) for number in range(24)]
    return MaskTrack.of(("carton", "bowl", "can", "mug"), np.arange(24) / 12.0, ((each, None) for each in maps))


def stream() -> Stream:
    """Joint states and poses of two seconds."""
    t = np.arange(60) / 30.0
    joints = Joints(
        names=("shoulder", "elbow", "wrist"),
        stamps=t,
        positions=np.stack([np.sin(2 * t), 0.6 * np.cos(3 * t), 0.4 * np.sin(5 * t + 1)], axis=1),
    )
    with tempfile.TemporaryDirectory() as folder:
        made = mcap.record(Path(folder, "a.mcap"), joints={"/joint_states": joints}, poses={"/hand": trajectory()})
        return made.model_copy(update={"file": type(made.file)(data=made.file.data)})


def scene() -> SceneDescription:
    """Box, bowl and laptop on a table."""
    assets = {
        "box": factories.box_asset(factories.pose(-0.25, -0.1, 0.0, 0.4)),
        "bowl": factories.bowl_asset(factories.pose(0.0, -0.2)),
        "laptop": factories.laptop_asset(factories.pose(0.12, 0.12)),
    }
    return twins.described(assets, lens=tabletops.FINE, eye=tabletops.EYE)


EXAMPLES: dict[str, Callable[[], Artifact]] = {
    "Image": lambda: table().capture.photograph.rgb,
    "DepthImage": lambda: DepthImage(depth=np.minimum(table().capture.measured.depth.depth, 2.0)),  # type: ignore[union-attr]
    "LabelImage": lambda: table().labels,
    "InstanceMap": lambda: InstanceMap(labels=table().labels.labels, fixed=np.zeros((480, 640), bool)),
    "ObjectView": view,
    "Mesh": mug,
    "Body": lambda: factories.laptop_asset().body,
    "SceneDescription": scene,
    "PointCloud": cloud,
    "Splats": splats,
    "Room": lambda: Room(splats=splats(), points=cloud()),
    "Views": views,
    "Panorama": panorama,
    "Rig": rig,
    "BrownConrady": lambda: BrownConrady(**tabletops.FINE.model_dump(), k1=-0.28, k2=0.07, p1=0.001, p2=0.0),
    "KannalaBrandt": lambda: KannalaBrandt(width=640, height=480, fx=210.0, fy=210.0, cx=320.0, cy=240.0, k1=-0.02),
    "Equirectangular": lambda: Equirectangular(width=640, height=320),
    "Calibration": calibration,
    "Trajectory": trajectory,
    "Track": track,
    "Stream": stream,
    "HandStream": hand_streams.stream,
    "Video": video,
    "MaskTrack": masks,
    "RgbdVideo": rgbd,
}
"""Type -> a value that shows what its picture looks like."""


def sheet() -> bytes:
    """JPEG of the pictures of all examples, each with the name of its type."""
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    rows = -(-len(EXAMPLES) // _COLUMNS)
    width, height = _TILE
    page = Pillow.new("RGB", (_COLUMNS * (width + 8), rows * (height + _LABEL + 8)), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(15)
    for number, (name, make) in enumerate(EXAMPLES.items()):
        left, top = number % _COLUMNS * (width + 8) + 4, number // _COLUMNS * (height + _LABEL + 8) + 4
        picture = Pillow.open(io.BytesIO(make().picture() or b"")).convert("RGB")
        factor = min(width / picture.width, height / picture.height)
        picture = picture.resize((round(picture.width * factor), round(picture.height * factor)))
        draw.text((left, top), name, "black", font)
        page.paste(picture, (left + (width - picture.width) // 2, top + _LABEL + (height - picture.height) // 2))
    written = io.BytesIO()
    page.save(written, "JPEG", quality=85)
    return written.getvalue()


if __name__ == "__main__":
    (Path(sys.argv[1]) if len(sys.argv) > 1 else SHEET).write_bytes(sheet())
