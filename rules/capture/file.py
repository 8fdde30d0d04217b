"""capture.file: an artifact from a file of another program."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import PositiveFloat, model_validator

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import MachineError, install_extra, smallest_extra
from dextera_build.rule import Context, Options, rule

from . import readers
from .readers import Read

_DISTRIBUTIONS = {"cv2": "opencv-python-headless", "pxr": "usd-core", "mcap_ros2": "mcap-ros2-support"}
"""Module -> its distribution, where the names differ."""
_OPTIONS_OF = {
    "frame": ("Panorama", "PointCloud", "Splats", "Trajectory", "Views"),
    "child": ("Trajectory",),
    "unit_m": ("Mesh",),
    "up": ("Mesh",),
    "repair": ("Mesh",),
    "topics": ("Stream",),
}
"""Option -> the types that it is for."""


class FileOptions(Options):
    """Options of capture.file. The format of a file is recognised by its content."""

    type: Literal[
        "BrownConrady",
        "Calibration",
        "Camera",
        "Equirectangular",
        "KannalaBrandt",
        "LabelImage",
        "Mesh",
        "Panorama",
        "PointCloud",
        "Rig",
        "Splats",
        "Stream",
        "Track",
        "Trajectory",
        "Video",
        "Views",
    ]
    """Type of the artifact."""
    path: str = ""
    """The file in a folder; "" if the folder holds only one that can be read. `Views` take the whole folder."""
    frame: str = ""
    """Frame of coordinates or poses; "": as stated in the file, otherwise `world`."""
    child: str = ""
    """Moving frame of a `Trajectory`; "": as stated in the file, otherwise `camera`."""
    unit_m: PositiveFloat = 1.0
    """Length of a unit of a `Mesh` file [m]; for USD, a factor on the unit that it states."""
    up: Literal["x", "y", "z", "file"] = "file"
    """Up axis of a `Mesh` file; `file`: as stated in the file, otherwise y for GLB and z for other formats."""
    repair: bool = False
    """Merge vertices of a `Mesh`, orient faces consistently and fill holes; a mesh that stays open is refused."""
    topics: tuple[str, ...] = ()
    """Topics that a `Stream` must contain."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name, types in _OPTIONS_OF.items():
            if self.type not in types and getattr(self, name) != type(self).model_fields[name].default:
                raise ValueError(f"`{name}` is an option of {' and '.join(types)}, not of {self.type}")
        return self


@rule(version=1, packages=("numpy", "pillow", "pyyaml"), typed_by="type")
def file(
    ctx: Context,
    file: File | Folder,
    pose: Pose | None = None,
    camera_info: File | None = None,
    *,
    options: FileOptions,
) -> Read:
    """Return the content of a file, or of a file in a folder, as an artifact of the type in option `type`.

    Mesh: GLB, OBJ, PLY, STL, USD; of a folder, also the materials, textures and layers that it names there.
    PointCloud: PLY. Splats: PLY, USD. Views: COLMAP's text model, `transforms.json`. Lenses: ROS camera_info, COLMAP's
    `cameras.txt`. Rig: Kalibr's camchain. Trajectory: TUM. Track: CSV. Calibration: easy_handeye, with intrinsics in it
    or in a ROS `camera_info`. Stream: MCAP. Video: MP4, MKV, MOV. Panorama: PNG, JPEG, at `pose`. LabelImage: PNG.
    """
    given = readers.Given(ctx, file, options.path, options.frame)
    try:
        return _read(given, pose, camera_info, options)
    except ModuleNotFoundError as error:  # other types are read without it
        module = str(error.name).partition(".")[0]
        raise MachineError(
            f"reading a {options.type} needs `{error.name}`, which is not installed",
            code="DXB-E302",
            hint=install_extra(smallest_extra([_DISTRIBUTIONS.get(module, module)])),
        ) from None


def _read(given: readers.Given, pose: Pose | None, camera_info: File | None, options: FileOptions) -> Read:
    match options.type:
        case "Mesh":
            return readers.mesh(given, options.unit_m, options.up, repair=options.repair)
        case "Panorama":
            return readers.panorama(given, pose)
        case "Calibration":
            return readers.calibration(given, camera_info)
        case "Stream":
            return readers.stream(given, options.topics)
        case "Trajectory":
            return readers.trajectory(given, options.child)
        case "BrownConrady" | "Camera" | "Equirectangular" | "KannalaBrandt" as lens:
            return readers.lens(given, lens)
        case other:
            return readers.READERS[other](given)
