"""Links and joints from two captures in different states: each part moves by a rotation or a translation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.objects.view import Seen, State
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.statistics import Z90

from .. import manifolds
from ..measured import Measurements
from . import clouds, cut, states, sweep
from .parts import Parts
from .picture import draw
from .screw import Screw

if TYPE_CHECKING:
    from manifold3d import Manifold

    from .articulate import ArticulateOptions

BACKEND = Backend(
    summary="joints from two captures in different states, by the motion of each part",
    packages=("manifold3d", "pillow", "scipy"),
    extra="twin",
)

WIDEST_TURN = np.radians(135.0)
"""Range of the search for a collision [rad]."""
WHOLE = 0.98
"""Smallest fraction of a wall inside the link that it belongs to."""


class ScrewOptions(Options):
    """Options of backend `screw` of factorize.articulate."""

    margin_rad: PositiveFloat = 0.05
    """Assumed minimum range of a hinge beyond the observed states if nothing blocks it [rad]."""
    margin_m: PositiveFloat = 0.005
    """Assumed minimum range of a slide beyond the observed states if nothing blocks it [m]."""
    largest_sigma_rad: PositiveFloat = 0.1
    """Largest accepted standard deviation of the direction of an axis [rad]."""
    largest_sigma_m: PositiveFloat = 0.02
    """Largest accepted standard deviation of the position of an axis [m]."""


def parts(
    ctx: Context,
    shape: Shape,
    measured: Measurements[Seen],
    again: State | None,
    common: ArticulateOptions,
    options: ScrewOptions,
) -> Parts | None:
    """Find the parts that moved between both captures, and cut the shape at them.

    Joint positions are 0 in the photograph and positive towards the second state.
    """
    if again is None:
        ctx.log("no second capture: give the input `again`, as `twin/two_states` does")
        return None
    seen = measured.needed()
    if shape.pose is None:
        ctx.fail(
            "`screw` needs the pose of the shape in the world", hint="use a backend of `factorize.mesh` with depth"
        )
    first, second = clouds.of_view(seen), _second(again)
    found = states.find(first, second)
    if found is None:
        ctx.log("no part of the object moved between both captures")
        return None
    to_object = transforms.invert(shape.pose.matrix)
    points = transforms.apply(to_object, first.inner.points)
    solids = cut.solids(shape.mesh, points, found.labels)
    if solids is None:
        ctx.warn("a part that moved is outside the mesh, which cannot be cut there")
        return None
    names = ["base", *(f"part_{number}" for number in range(1, len(solids)))]
    joints = []
    for number, screw in enumerate(found.screws, start=1):
        _refuse_unsure(ctx, names[number], screw, found.doubts[number - 1], options)
        others = [solid for k, solid in enumerate(solids) if k != number]
        joints.append(_joint(names[number], screw, to_object, solids[number], others, options))
    walls = _walls(shape, solids)
    links = {
        name: Link(mesh=manifolds.mesh(solid, shape.mesh), walls=own)
        for name, solid, own in zip(names, solids, walls, strict=True)
    }
    metrics = tuple(
        metric
        for name, screw in zip(names[1:], found.screws, strict=True)
        for metric in (
            (f"{name} moved", *_moved(screw)),
            (f"{name} residual", 1000.0 * screw.residual, "mm"),
        )
    )
    return Parts(links, tuple(joints), None, metrics)


def _refuse_unsure(ctx: Context, name: str, screw: Screw, why: str, options: ScrewOptions) -> None:
    """Raise if the direction of a joint is undetermined, or if `why` gives a reason to reject the joint."""
    if screw.axis_sigma > options.largest_sigma_rad:
        ctx.fail(
            f"the axis of `{name}` is uncertain by {np.degrees(Z90 * screw.axis_sigma):.0f} deg (90 %)",
            hint="move the joint further between both captures, or look from where its part is seen in both",
            amount=_amount(screw),
        )
    if screw.origin_sigma > options.largest_sigma_m:
        why = f"its axis may be {1000.0 * Z90 * screw.origin_sigma:.0f} mm off (90 %)"
    if why:
        ctx.fail(
            f"the joint of `{name}` is not certain: {why}",
            hint="move one joint at a time between both captures, by 15 degrees or 3 cm at least, from one place",
            amount=_amount(screw),
        )


def _walls(shape: Shape, solids: list[Manifold]) -> list[tuple[Hull, ...]]:
    """The walls of each link: those inside it; none if a wall spans several links."""
    import manifold3d

    owned: list[list[Hull]] = [[] for _ in solids]
    for hull in shape.walls:
        wall = manifold3d.Manifold.hull_points(hull.vertices.astype(np.float64))
        inside = [float((wall ^ solid).volume()) for solid in solids]
        if max(inside) < WHOLE * float(wall.volume()):
            return [() for _ in solids]
        owned[int(np.argmax(inside))].append(hull)
    return [tuple(own) for own in owned] if all(owned) else [() for _ in solids]


def picture(ctx: Context, body: Body, seen: Seen, options: ScrewOptions) -> np.ndarray:
    """Draw the joints on the crop, (H, W, 3) uint8."""
    return draw(body, seen)


def _second(again: State) -> clouds.Sight:
    measured = again.measured
    k, pose = again.camera.matrix(), measured.camera_pose.matrix
    return clouds.of_depth(measured.depth.depth, again.above, k, pose, 3 * clouds.MOST)


def _joint(
    name: str, screw: Screw, to_object: np.ndarray, moving: Manifold, others: list[Manifold], options: ScrewOptions
) -> Joint:
    """The joint in the object frame; its limits have intervals from the observed range to the collision-free one."""
    turns = screw.type == "revolute"
    origin = transforms.apply(to_object, screw.origin)
    axis = to_object[:3, :3] @ screw.axis
    local = Screw(screw.type, origin, axis, screw.amount, 0.0, 0.0, 0.0, 0.0)
    margin = options.margin_rad if turns else options.margin_m
    reach = (
        WIDEST_TURN if turns else max(screw.amount + margin, float(np.ptp(np.reshape(moving.bounding_box(), (2, 3)))))
    )
    free_up, stopped_up = sweep.free(moving, others, local.motion, 0.0, max(reach, screw.amount))
    free_down, stopped_down = sweep.free(moving, others, local.motion, 0.0, -reach)
    top, bottom = max(free_up, screw.amount), min(free_down, 0.0)
    upper = top if stopped_up else min(top, screw.amount + margin) if top > screw.amount else screw.amount
    lower = bottom if stopped_down else max(bottom, -margin)
    x, y, z = origin.tolist()
    a, b, c = axis.tolist()
    return Joint(
        name=f"{'hinge' if turns else 'slide'}_{name.rpartition('_')[2]}",
        type=screw.type,
        parent="base",
        child=name,
        origin=(x, y, z),
        axis=(a, b, c),
        lower=lower,
        upper=upper,
        position=0.0,
        lower_range=(bottom, 0.0),
        upper_range=(screw.amount, top),
        axis_sigma_rad=screw.axis_sigma,
        origin_sigma_m=screw.origin_sigma if turns else None,
    )


def _amount(screw: Screw) -> str:
    value, unit = _moved(screw)
    return f"it moved by {value:.1f} {unit}"


def _moved(screw: Screw) -> tuple[float, str]:
    return (float(np.degrees(screw.amount)), "deg") if screw.type == "revolute" else (1000.0 * screw.amount, "mm")
