"""Panoramas in all directions around one point, as `transforms.json` with a mask."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.formats import unreadable
from dextera_build.artifacts.frames import Frames
from dextera_build.artifacts.image import Image, png
from dextera_build.artifacts.labels import path_fault
from dextera_build.artifacts.lens import Equirectangular
from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.views import Views, encoded
from dextera_build.errors import ArtifactError

_MASK = "mask_path"
"""Field of nerfstudio's frames: a single-channel picture, black at invalid pixels."""


class Panorama(Artifact):
    """A panorama in all directions around one point."""

    saves: ClassVar[tuple[str, ...]] = (".json",)
    image: Image
    """Equirectangular picture; its centre is straight ahead."""
    pose: Annotated[Pose, Frames(None, "camera")]
    """T_frame_camera: x right, y down, z ahead."""
    seen: Annotated[np.ndarray, Array("H W", "bool")] | None = None
    """Pixels seen by a camera; the others were filled in or generated. None: not stated."""

    @model_validator(mode="after")
    def _check_seen(self) -> Self:
        size = self.image.pixels.shape[:2]
        if self.seen is not None and self.seen.shape != size:
            raise ArtifactError(
                f"Panorama.seen is {self.seen.shape[1]} x {self.seen.shape[0]} px, but the picture is "
                f"{size[1]} x {size[0]} px",
                code="DXB-A203",
            )
        return self

    def lens(self) -> Equirectangular:
        """Its camera."""
        height, width = self.image.pixels.shape[:2]
        return Equirectangular(width=width, height=height)

    def views(self, name: str = "panorama.png") -> Views:
        """The same as views with one picture, without covariance and stamp of the pose, and without `seen`."""
        return Views(
            images={name: encoded(self.image.pixels)},
            names=(name,),
            camera=("1",),
            cameras={"1": self.lens()},
            poses=self.pose.matrix[None].copy(),
            frame=self.pose.parent,
        )

    def facts(self) -> Iterator[str]:
        """Size, the fraction of seen pixels, and the frame."""
        height, width = self.image.pixels.shape[:2]
        yield f"{width} x {height} px"
        if self.seen is not None:
            yield f"{self.seen.mean():.0%} seen"
        yield f"frame {self.pose.parent}"

    def picture(self) -> bytes:
        """The picture itself, smaller."""
        return self.image.picture()

    def _write(self, path: Path) -> list[Path]:
        written = self.views(f"{path.stem}.png").save(path)
        if self.seen is not None:
            mask = path.parent / "masks" / f"{path.stem}.png"
            mask.parent.mkdir(exist_ok=True)
            mask.write_bytes(png(self.seen))
            facts = json.loads(path.read_text())
            facts["frames"][0][_MASK] = mask.relative_to(path.parent).as_posix()
            path.write_text(json.dumps(facts, indent=1) + "\n")
            written.append(mask)
        return [*written, *self.pose.export(path.parent, f"{path.stem}.pose")]

    @classmethod
    def load(cls, path: str | Path) -> Panorama:
        """Read a `transforms.json` of one equirectangular picture, with its mask if it names one.

        Raises:
            ArtifactError: It is damaged, or of another kind.
        """
        views = Views.load(path)
        if [type(views.lens(name)) for name in views.names] != [Equirectangular]:
            raise unreadable(path, "a panorama", f"it holds {len(views.names)} pictures, not one of all directions")
        name = views.names[0]
        return cls(image=Image(pixels=views.pixels(name)), pose=views.pose(name), seen=_seen(Path(path)))


def _seen(path: Path) -> np.ndarray | None:
    """The mask (H, W) named in a valid `transforms.json`; None if there is none."""
    from PIL import Image as Pillow

    main = path / "transforms.json" if path.is_dir() else path
    named = json.loads(main.read_text())["frames"][0].get(_MASK) if main.is_file() else None
    if named is None:
        return None
    try:
        if fault := path_fault(str(named)):
            raise ValueError(fault)
        data = (main.parent / str(named)).read_bytes()
        with Pillow.open(io.BytesIO(data), formats=("PNG",)) as picture:
            return np.asarray(picture.convert("L")) > 0
    except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
        raise unreadable(path, "a panorama", f"its mask: {error}") from None
