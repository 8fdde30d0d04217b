"""`Rig` as the `camchain.yaml` of Kalibr."""

from __future__ import annotations

from pathlib import Path

from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.formats import camchain
from dextera_build.formats import lens as lens_files
from dextera_build.formats.files import suffix_among, unwritable


def save(rig: Rig, path: Path) -> list[Path]:
    """Write a camchain."""
    rows = [
        camchain.Mounted(label, lens_files.numbers(rig.cameras[label]), pose.matrix, pose.covariance)
        for label, pose in sorted(rig.poses.items())
    ]
    try:
        path.write_text(camchain.written(rows))
    except ValueError as error:
        raise unwritable(Rig.name(), "a Kalibr camchain", error) from None
    return [path]


def load(path: str | Path) -> Rig:
    """Read a Kalibr `camchain.yaml`; the rig's frame is that of the IMU, or of the first camera without one.

    Raises:
        ArtifactError: It is no such file, or its numbers are no valid cameras.
    """
    suffix_among("Rig", Path(path), (".yaml", ".yml"))
    return parse(Path(path).read_bytes(), path)


def parse(data: bytes, path: str | Path) -> Rig:
    """The rig in the content of a camchain that is named `path`."""
    try:
        found = camchain.read(data.decode())
    except ValueError as error:
        raise unreadable(path, "a Kalibr camchain", error) from None
    return Rig(
        cameras={each.label: lens_files.of(each.lens) for each in found},
        poses={
            each.label: Pose(parent="rig", child=each.label, matrix=each.pose, covariance=each.covariance)
            for each in found
        },
    )
