"""Former addresses of rules."""

from __future__ import annotations

from dextera_build.errors import Place, RecipeError

RENAMED = {
    "capture.aim": "reference.look_at",
    "capture.calibration": "capture.file, type: Calibration",
    "capture.catalogue": "reference.catalogue",
    "capture.draw": "reference.draw",
    "capture.draws": "reference.draw_list",
    "capture.emptied": "reference.background_views",
    "capture.generated": "reference.perfect_asset",
    "capture.install": "reference.place_robot",
    "capture.labels": "capture.file, type: LabelImage, path: instances.png",
    "capture.lens": "capture.file, type: Camera",
    "capture.lifted": "reference.pixels_as_splats",
    "capture.mesh": "capture.file, type: Mesh",
    "capture.moved_camera": "reference.move_camera",
    "capture.opened": "reference.open_joints",
    "capture.panorama": "capture.file, type: Panorama",
    "capture.pieces": "reference.convex_pieces",
    "capture.points": "capture.file, type: PointCloud",
    "capture.postures": "reference.postures",
    "capture.reference": "reference.photograph",
    "capture.reference_views": "reference.robot_views",
    "capture.rig": "capture.file, type: Rig",
    "capture.splats": "capture.file, type: Splats",
    "capture.stand": "reference.place_robot_in_view",
    "capture.stream": "capture.file, type: Stream",
    "capture.track": "capture.file, type: Track",
    "capture.trajectory": "capture.file, type: Trajectory",
    "capture.truth": "reference.truth",
    "capture.video": "capture.file, type: Video",
    "capture.views": "capture.file, type: Views",
    "capture.world": "reference.world",
    "evaluate.aligned": "benchmark.scene_alignment_error",
    "evaluate.calibrated": "benchmark.calibration_error",
    "evaluate.compared": "benchmark.method_table",
    "evaluate.curves": "benchmark.curves",
    "evaluate.dimensions": "benchmark.dimensions",
    "evaluate.gather": "benchmark.gather",
    "evaluate.goals": "benchmark.error_limits",
    "evaluate.instances": "benchmark.instances",
    "evaluate.operated": "evaluate.operator_trials",
    "evaluate.outcomes": "evaluate.success_rates",
    "evaluate.placements": "benchmark.pose_errors",
    "evaluate.rest": "benchmark.settle_table",
    "evaluate.rooms": "benchmark.room_table",
    "evaluate.scaled": "benchmark.scale_error",
    "evaluate.shots": "benchmark.view_captures",
    "evaluate.stood": "benchmark.base_error",
    "evaluate.summary": "benchmark.summary",
    "evaluate.yields": "benchmark.yields",
    "simulate.reference": "reference.task",
}
"""Former address -> the current text after `rule:` in a recipe: the address, with options if the rule needs them."""


def renamed(path: str, where: Place | None) -> RecipeError | None:
    """The error for a former address, with the current one; None if `path` is none."""
    if path not in RENAMED:
        return None
    now = RENAMED[path]
    return RecipeError(
        f"the rule `{path}` is now `{now.partition(',')[0]}`", code="DXB-R201", where=where, hint=f"write `rule: {now}`"
    )
