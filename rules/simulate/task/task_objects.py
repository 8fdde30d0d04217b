"""The movable objects of a task: properties of assets that resets and success tests need."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.tasks.task import Cavity, TaskObject
from dextera_build.errors import listing
from dextera_build.geometry import cavities, kinematics, metrics
from dextera_build.rule import Context
from dextera_build.sim.model import completeness, names


def check(ctx: Context, scene: Scene, labels: Mapping[str, str], assets: Collection[Asset]) -> None:
    """Raise for assets that are not part of the scene, or that cannot be simulated.

    Args:
        ctx: Context for errors.
        scene: The twin.
        labels: Label -> body of every movable object.
        assets: The twin's assets.
    """
    for label, body in labels.items():
        ctx.check(
            body in scene.bodies,
            f"the scene has no body of asset `{label}`",
            assets=listing(assets.items, most=20),
            scene=listing(scene.bodies, most=20),
            hint="give the assets that `simulate.scene` was given",
        )
    completeness.check({label: assets.items[label] for label in labels})


def described(assets: Collection[Asset], label: str, count: int) -> TaskObject:
    """One asset as the object of a task, with `count` points of its surface."""
    asset = assets.items[label]
    low, high = 1.0, 1.0
    total = sum(link.mass_kg for link in asset.physics.links.values())
    if total > 0:
        low = sum(link.mass_low_kg for link in asset.physics.links.values()) / total
        high = sum(link.mass_high_kg for link in asset.physics.links.values()) / total
    return TaskObject(
        joints=_joint_names(assets, label),
        pose=asset.pose,
        positions=tuple(joint.position for joint in asset.body.joints),
        mass_scale=(low, high),
        scale_sigma=asset.scale_sigma,
        friction=asset.physics.friction,
        friction_sigma=asset.physics.friction_sigma,
        points=metrics.sample_surface(*kinematics.posed_surface(asset.body), count, seed=0).astype(np.float32),
    )


def hollowed(thing: TaskObject, asset: Asset) -> TaskObject:
    """The object with its interior space, joints as in the photograph; None if it cannot contain anything."""
    found = cavities.find(*kinematics.posed_surface(asset.body))
    if found is None:
        return thing
    corner, cell, floor, rim = found
    room = Cavity(corner_m=corner, cell_m=cell, floor_m=floor.astype(np.float32), rim_m=rim.astype(np.float32))
    return thing.model_copy(update={"cavity": room})


def _joint_names(assets: Collection[Asset], label: str) -> tuple[str, ...]:
    """Names in the MJCF: body of the child link and joint."""
    links = names.link_names(assets.items)
    return tuple(f"{links[label, joint.child]}_{names.plain(joint.name)}" for joint in assets.items[label].body.joints)
