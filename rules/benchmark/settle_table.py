"""benchmark.settle_table: a settle report as a table."""

from __future__ import annotations

import math

from dextera_build.artifacts.scenes.scene import SettleReport
from dextera_build.artifacts.table import Column, Table
from dextera_build.rule import Context, rule


@rule(version=2)
def settle_table(ctx: Context, settled: SettleReport) -> Table:
    """Return one row per body: translation, rotation, penetration, and whether it rests."""
    resting = sum(body.resting for body in settled.bodies)
    ctx.say(f"{resting} of {len(settled.bodies)} bodies rest")
    return Table(
        title=f"Bodies after {settled.seconds:g} s of simulation",
        columns=(
            Column(name="body"),
            Column(name="drift", unit="mm", digits=2, better="lower"),
            Column(name="tilt", unit="deg", digits=2, better="lower"),
            Column(name="penetration", unit="mm", digits=2, better="lower"),
            Column(name="rests"),
        ),
        rows=tuple(
            (
                body.name,
                1000.0 * body.drift_m,
                math.degrees(body.tilt_rad),
                1000.0 * body.penetration_m,
                "yes" if body.resting else "no",
            )
            for body in settled.bodies
        ),
    )
