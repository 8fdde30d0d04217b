"""Cameras of policies: what each gives, and the names of its channels.

`rgb` is the picture of the only camera, `rgb/front` that of the camera `front` among several.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from dextera_build.artifacts import base
from dextera_build.artifacts.tasks.policy import Channel, Encoding, ViewSpec
from dextera_build.artifacts.tasks.task import View
from dextera_build.errors import RuleError
from dextera_build.geometry import quaternions

PICTURE = "workspace"
"""Name of a single camera."""
TERMS: dict[str, Encoding] = {"rgb": "picture", "depth": "depth", "cloud": "cloud"}
"""Terms that a camera gives -> their encodings."""
NAME = re.compile(r"[a-z][a-z0-9_]*")
"""Names of cameras, which all forms of data sets and ROS take."""


@dataclass(frozen=True)
class Shown:
    """What a camera gives."""

    height: int
    """Height of a frame [px]."""
    width: int
    """Width of a frame [px]."""
    depth: bool = True
    """Whether it also gives depth, and with it points."""
    view: ViewSpec | None = field(default=None, compare=False)
    """Its lens and place; None: not stated."""

    @property
    def terms(self) -> tuple[str, ...]:
        """Its terms."""
        return tuple(TERMS) if self.depth else ("rgb",)

    @property
    def size(self) -> str:
        """The size of a frame in words."""
        return f"{self.width} x {self.height} px"

    def shape(self, term: str) -> tuple[int, ...]:
        """Shape of one sample of a term."""
        return (self.height, self.width) if term == "depth" else (self.height, self.width, 3)


def channel_of(term: str, camera: str) -> str:
    """Name of the channel of a camera's term; the only camera is called `PICTURE`."""
    return term if camera == PICTURE else f"{term}/{camera}"


def term_of(channel: str) -> str:
    """The term of a channel: `rgb` of `rgb/front`."""
    return channel.partition("/")[0]


def camera_of(channel: str) -> str:
    """The camera of a channel: `front` of `rgb/front`, `PICTURE` of `rgb`."""
    return channel.partition("/")[2] or PICTURE


def is_seen(channel: str) -> bool:
    """Whether a camera gives the channel."""
    return term_of(channel) in TERMS


def is_named(channel: str) -> bool:
    """Whether the channel is one of a camera among several, of a possible name."""
    return is_seen(channel) and NAME.fullmatch(camera_of(channel)) is not None


def spread(inputs: Iterable[str], cameras: Collection[str]) -> tuple[str, ...]:
    """Replace `rgb`, the pictures of every camera, by the channels of the cameras; likewise `depth` and `cloud`.

    Args:
        inputs: Channels, of which `rgb/front` is that of one camera.
        cameras: All cameras; without any, the inputs stay as they are.
    """
    found: dict[str, None] = {}
    for name in inputs:
        every = name in TERMS and cameras
        found |= dict.fromkeys([channel_of(name, camera) for camera in sorted(cameras)] if every else [name])
    return tuple(found)


def given(view: View | None, views: base.Collection[View] | None = None) -> dict[str, View]:
    """Camera -> its view, from the inputs of a rule: `view` of the only camera, or `views` of several by name.

    Raises:
        RuleError: Both are given, or a name is none of a camera.
    """
    if views is None:
        return {} if view is None else {PICTURE: view}
    if view is not None:
        raise RuleError("`view` is for one camera, `views` for several", code="DXB-B519", hint="give either of them")
    check_names(views.items)
    return dict(views.items)


def check_names(names: Iterable[str]) -> None:
    """Raise for names that no camera can have.

    Raises:
        RuleError: There is one.
    """
    for name in names:
        if NAME.fullmatch(name) is None:
            raise RuleError(
                f"`{name}` cannot name a camera", code="DXB-B519", hint="take small letters, digits and underscores"
            )


def shown_in(channel: Channel) -> Shown:
    """What the camera of a channel gives."""
    return Shown(channel.shape[0], channel.shape[1])


def sizes(views: Mapping[str, View]) -> dict[str, Shown]:
    """Camera -> what it gives."""
    return {name: Shown(view.camera.height, view.camera.width, view=stated(view)) for name, view in views.items()}


def stated(view: View) -> ViewSpec:
    """A camera in numbers."""
    camera, matrix = view.camera, view.camera_pose.matrix
    sigma_m, sigma_rad = view.camera_pose.sigma() or (0.0, 0.0)
    x, y, z = matrix[:3, 3].tolist()
    w, i, j, k = quaternions.from_matrix(matrix[:3, :3]).tolist()
    return ViewSpec(
        size_px=(camera.width, camera.height),
        focal_px=(camera.fx, camera.fy),
        centre_px=(camera.cx, camera.cy),
        position_m=(x, y, z),
        quaternion=(w, i, j, k),
        sigma_m=sigma_m,
        sigma_rad=sigma_rad,
    )
