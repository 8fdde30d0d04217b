"""Former addresses of rules."""

from __future__ import annotations

from dextera_build.errors import Place, RecipeError

RENAMED = {
    "capture.calibration": "capture.file, type: Calibration",
    "capture.labels": "capture.file, type: LabelImage, path: instances.png",
    "capture.lens": "capture.file, type: Camera",
    "capture.mesh": "capture.file, type: Mesh",
    "capture.panorama": "capture.file, type: Panorama",
    "capture.points": "capture.file, type: PointCloud",
    "capture.rig": "capture.file, type: Rig",
    "capture.splats": "capture.file, type: Splats",
    "capture.stream": "capture.file, type: Stream",
    "capture.track": "capture.file, type: Track",
    "capture.trajectory": "capture.file, type: Trajectory",
    "capture.video": "capture.file, type: Video",
    "capture.views": "capture.file, type: Views",
}
"""Former address -> what a recipe writes after `rule:` today: the address, with options if the rule needs them."""


def renamed(path: str, where: Place | None) -> RecipeError | None:
    """The error for a former address, with the current one; None if `path` is none."""
    if path not in RENAMED:
        return None
    now = RENAMED[path]
    return RecipeError(
        f"the rule `{path}` is now `{now.partition(',')[0]}`", code="DXB-R201", where=where, hint=f"write `rule: {now}`"
    )
