"""factorize.articulate: links and joints of one object."""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.objects.view import MeasuredView, ObjectView, Seen, State, Traits
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from ..measured import Measurements, of_view
from . import hinted
from .parts import Parts
from .picture import strip


class DeclaredHinge(Options):
    """A measured hinge, in the object frame."""

    origin_m: tuple[float, float, float]
    """A point on the axis [m]."""
    axis: tuple[float, float, float]
    """Direction; the lid opens by the right-hand rule."""
    angle_rad: NonNegativeFloat
    """Opening angle in the photograph [rad]; 0 is closed."""


class ArticulateOptions(Options):
    """Options of factorize.articulate."""

    hinge: DeclaredHinge | None = None
    """Known hinge; None estimates it with the backend."""
    upper_rad: PositiveFloat = 2.29
    """Upper joint limit if there is no collision [rad]; notebooks stop near 131 degrees."""
    overlap_m: NonNegativeFloat = 0.001
    """Maximum mean penetration of the lid into the base while closing [m]."""
    without_crease: Literal["fail", "rigid"] = "fail"
    """Treatment of an articulated object in which no joint is found."""


class ArticulateBackend(Protocol):
    """Interface of a backend of factorize.articulate."""

    def parts(
        self,
        ctx: Context,
        shape: Shape,
        measured: Measurements[Seen],
        again: State | None,
        common: ArticulateOptions,
        options: Any,
    ) -> Parts | None:
        """Split the shape at its joints and close the parts; None if no joint is found."""
        ...

    def picture(self, ctx: Context, body: Body, seen: Seen, options: Any) -> np.ndarray | None:
        """Draw the joints on the crop, (H, W, 3) uint8; None for no picture."""
        ...


@rule(version=4, tolerance=Tolerance({"": ROUNDING}))
def articulate(
    ctx: Context[ArticulateBackend],
    shape: Shape,
    traits: Traits,
    view: ObjectView,
    measured: MeasuredView | None = None,
    camera: Camera | None = None,
    again: State | None = None,
    *,
    options: ArticulateOptions | None = None,
) -> Body:
    """Return links and joints in the object frame of `shape`, with all geometry at joint position 0 [m, rad].

    Joints stated in `scene.yaml` take precedence; `camera`, that of the whole photograph, relates its pixels to the
    object. `again` is a second capture of the object with its joints in other positions.
    """
    options = options or ArticulateOptions()
    rigid = traits.body_type == "rigid"
    if rigid and not traits.joints and again is None:
        ctx.say("rigid, 1 link")
        return _rigid(shape)
    depth = of_view(ctx, view, measured)
    found = _found(ctx, shape, depth, traits, camera, again, options)
    if found is None:
        ctx.say("rigid, 1 link" if rigid else "kept rigid: no joint found")
        return _rigid(shape)
    for name, link in found.links.items():
        hint = "the mesh has to be cut into closed solids, try another backend of `factorize.mesh`"
        ctx.check(link.mesh.is_closed, f"link `{name}` is open after the cut", hint=hint)
    if found.overlap_m is not None:
        ctx.check(
            found.overlap_m <= options.overlap_m,
            f"the lid sinks {found.overlap_m * 1000:.1f} mm into the base while it closes",
            hint="declare `hinge`, or raise `overlap_m` where the mesh is coarse",
            allowed_mm=options.overlap_m * 1000,
        )
        ctx.metric("overlap", found.overlap_m * 1000.0, "mm")
    shape = found.shape or shape
    body = Body(
        links=found.links,
        joints=found.joints,
        pose=shape.pose,
        hollow=shape.hollow,
        asset_source=depth.source(shape.asset_source),
        certainty=shape.certainty(),
    )
    seen = depth.for_check()
    pixels = None if seen is None or body.pose is None else ctx.backend.picture(ctx, body, seen, ctx.backend_options)
    if pixels is not None:
        ctx.preview(pixels, "joint axes, and the links swept between the limits")
        ctx.preview(strip(body), "from the lower to the upper limit, one row per joint")
    for joint in found.joints:
        name = "position" if len(found.joints) == 1 else f"position of {joint.name}"
        ctx.metric(name, joint.position, "rad" if joint.type == "revolute" else "m")
    for name, value, unit in found.metrics:
        ctx.metric(name, value, unit)
    ctx.say(_line(found.joints))
    return body


def _found(
    ctx: Context[ArticulateBackend],
    shape: Shape,
    depth: Measurements[Seen],
    traits: Traits,
    camera: Camera | None,
    again: State | None,
    options: ArticulateOptions,
) -> Parts | None:
    """Links and joints as stated, else from motion between captures, else from the shape; None keeps it rigid."""
    if traits.joints:
        return hinted.parts(ctx, shape, depth, traits.joints, camera)
    rigid = traits.body_type == "rigid"
    found: Parts | None = ctx.backend.parts(ctx, shape, depth, again, options, ctx.backend_options)
    if found is None and again is not None and not rigid:
        # The object has joints, but none moved between the captures.
        found = ctx.backend.parts(ctx, shape, depth, None, options, ctx.backend_options)
    if found is None and not rigid and options.without_crease == "fail":
        hint = (
            "set `body_type: rigid` of the element in `scene.yaml`, state its `joints` there with `part_px` and "
            "`axis_px`, capture it twice with the joint elsewhere (`twin/two_states`), or set `without_crease: rigid`"
        )
        ctx.fail("no joint was found", hint=hint, hypothesis=shape.hypothesis)
    return found


def _line(joints: tuple[Joint, ...]) -> str:
    """`1 hinge, 0-131 deg, at 108 deg`, or `2 hinges, 1 slide`."""
    if len(joints) == 1 and joints[0].type == "revolute":
        lower, upper, position = np.degrees([joints[0].lower, joints[0].upper, joints[0].position])
        return f"1 hinge, {lower:.0f}-{upper:.0f} deg, at {position:.0f} deg"
    counts = Counter("hinge" if joint.type == "revolute" else "slide" for joint in joints)
    return ", ".join(f"{number} {name}{'s' if number > 1 else ''}" for name, number in sorted(counts.items()))


def _rigid(shape: Shape) -> Body:
    base = Link(mesh=shape.mesh, walls=shape.walls)
    return Body(
        links={"base": base},
        pose=shape.pose,
        hollow=shape.hollow,
        asset_source=shape.asset_source,
        certainty=shape.certainty(),
    )
