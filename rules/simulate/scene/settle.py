"""simulate.settle: simulate the scene and check that all bodies rest as photographed."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import PositiveFloat

from dextera_build.artifacts.scenes.scene import Scene, SettleReport
from dextera_build.errors import listing
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from .curves import settle_picture


class SettleOptions(Options):
    """Options of simulate.settle."""

    seconds: PositiveFloat = 5.0
    """Simulated time [s]."""
    max_tilt_rad: PositiveFloat = 0.17
    """Maximum rotation of a body that did not fall over [rad]."""
    max_drift_m: PositiveFloat = 0.005
    """Maximum displacement of a body that stays at its photographed pose [m]."""
    max_depth_m: PositiveFloat = 0.0005
    """Maximum penetration of a body at rest [m]."""
    max_joint_rad: PositiveFloat = 0.05
    """Maximum motion of a joint that holds its position [rad or m]."""
    max_speed_m_s: PositiveFloat = 0.01
    """Maximum final speed of a body at rest [m/s]."""
    max_turn_rad_s: PositiveFloat = 0.1
    """Maximum final angular speed of a body at rest [rad/s]."""
    max_energy: PositiveFloat = 0.01
    """Maximum change of the mechanical energy after the first half second, as a fraction of m g h of the bodies."""


class SettleBackend(Protocol):
    """Interface of a backend of simulate.settle."""

    def let_go(self, ctx: Context, scene: Scene, common: SettleOptions, options: Any) -> SettleReport:
        """Simulate the scene and evaluate every body."""
        ...


@rule(version=4, tolerance=Tolerance({"": ROUNDING}))
def settle(ctx: Context[SettleBackend], scene: Scene, *, options: SettleOptions) -> SettleReport:
    """Return how far each body of `scene` moved [m, rad, world frame] within `options.seconds` of free simulation.

    The report is valid whether or not the scene passes; see `passed`.
    """
    report: SettleReport = ctx.backend.let_go(ctx, scene, options, ctx.backend_options)
    names = {body.name for body in report.bodies}
    ctx.check(names == set(scene.bodies), "the report does not name the scene's bodies", bodies=sorted(names))
    drift = max((body.drift_m for body in report.bodies), default=0.0)
    depth = max((body.penetration_m for body in report.bodies), default=0.0)
    ctx.metric("drift", drift * 1000, "mm")
    ctx.metric("penetration", depth * 1000, "mm")
    ctx.metric("resting", sum(body.resting for body in report.bodies), f"of {len(report.bodies)}")
    if report.energy_change is not None:
        ctx.metric("energy", 100 * report.energy_change, "% of m g h")
    restless = [body.name for body in report.bodies if not body.resting]
    verdict = f"does not rest: {', '.join(restless)}" if restless else "settles"
    if not restless and not report.passed:
        verdict = "rests, but its energy changes"
    if scene.held:
        verdict = _counted(scene) + ("" if verdict == "settles" else f"; {verdict}")
    if scene.scale == "unknown":
        verdict += ", scale unknown"
    ctx.say(f"{verdict}, drift {drift * 1000:.1f} mm, penetration {depth * 1000:.1f} mm")
    ctx.preview(settle_picture(report), verdict)
    return report


def _counted(scene: Scene) -> str:
    """`4 of 6 stand free, 2 held: mug (nothing carries it: it would fall by 412 mm), tin (it is 9 mm inside mug)`."""
    free, held = len(scene.bodies), len(scene.held)
    reasons = listing([f"{name} ({why})" for name, why in scene.held.items()], most=6)
    return f"{free} of {free + held} {'stands' if free == 1 else 'stand'} free, {held} held: {reasons}"
