"""simulate.scene: combine the assets and the static scene into a MuJoCo model."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.scenes.scene import Background, Scene
from dextera_build.rule import Context, rule
from dextera_build.sim.model import description, mjcf, names, neighbours

from .amounts import amount
from .metric import metric

NOTABLE_M = 0.005
"""Overlap above which a warning is given, because an unseen part of a shape is wrong [m]."""


@rule(version=4, packages=("scipy",))
def scene(ctx: Context, assets: Collection[Asset], background: Background, support: Support, camera: Camera) -> Scene:
    """Return the twin as MJCF in the world frame [m, kg, rad]: z up, support at z = 0, camera `capture`.

    If `support.scale` is `unknown`, its unit is not the metre, and no task can be built on it.

    Every object is a free body with explicit mass properties, a textured visual and convex collision pieces; keyframe
    `home` contains the pose and the joint positions of the photograph. Where neighbours overlap, one of them is cut
    back, see `dextera_build.sim.model.neighbours`.
    """
    room = metric(background, support.factor)
    found = description.parted(assets.items, room)
    placed, cuts = found.assets, found.cuts
    for cut in cuts:
        _told(ctx, cut)
    for label, gap in found.feet.items():
        ctx.warn(f"{label} was seen {1000 * gap:.0f} mm above what carries it: it gets feet, which are not drawn")
    model = mjcf.write(description.describe(found, room, camera, support.camera_pose.matrix))
    joints = sum(len(asset.body.joints) for asset in placed.values())
    pieces = sum(len(part.hulls) for asset in placed.values() for part in asset.collision.links.values())
    mass = sum(link.mass_kg for asset in placed.values() for link in asset.physics.links.values())
    ctx.metric("bodies", len(placed))
    ctx.metric("joints", joints)
    ctx.metric("collision pieces", pieces)
    ctx.metric("mass", mass, "kg")
    ctx.metric("overlap", 1000 * max((cut.deep_m for cut in cuts), default=0.0), "mm")
    unknown = ", scale unknown" if support.scale == "unknown" else ""
    known = names.body_names(placed)
    bodies, cut_off = tuple(known.values()), tuple(name for label, name in known.items() if placed[label].cut)
    ctx.say(f"{amount(len(bodies), 'body', 'bodies')}, {amount(joints, 'joint')}, {mass:.2f} kg{unknown}")
    return Scene(
        model=model,
        camera=camera,
        camera_pose=support.camera_pose,
        bodies=bodies,
        cut=cut_off,
        scale=support.scale,
    )


def _told(ctx: Context, cut: neighbours.Cut) -> None:
    if cut.deep_m > NOTABLE_M:
        by = cut.by or "the static scene"
        ctx.warn(
            f"{cut.body} and {by} overlap by {1000 * cut.deep_m:.0f} mm: {cut.lost:.0%} of {cut.body} collides no more"
        )
