"""Convert physics artifacts to MuJoCo contact and joint parameters.

**Restitution.** A MuJoCo contact is a damped spring that pushes and never pulls. For a damping ratio z < 1 it returns
the speed times e = exp(-z (pi - 2 asin z) / sqrt(1 - z^2)), for z > 1 times exp(-z / r ln((z + r) / (z - r))) with
r = sqrt(z^2 - 1) (Schwager and Poeschel 2007); z = 1 gives e^-2. `solref` takes (time constant, z); the natural
frequency is 1 / (time constant * z) and is kept at `CONTACT_RATE` for every e, so bouncy objects are no stiffer than
others. Damping is limited to `MOST_DAMPED` (e = 0.11), because above 1.6 resting bodies chatter at a 2 ms step. A body
that starts in slight penetration is pushed out slowly, not thrown.

**Friction.** Sliding friction is the body's own. Object geoms have priority 1, the static scene 0, so the object's
parameters take precedence over the table's; between two objects MuJoCo uses the larger friction. Torsional and rolling
friction are lengths [m], from the radius of a small contact patch.

**Hinges.** A joint that holds its position in the photograph has at least the dry friction to resist gravity. `HOLD`
times the maximum gravity torque over the motion matches laptop hinges: they hold, and a hand moves them.
"""

from __future__ import annotations

import math

import numpy as np

from dextera_build.artifacts.object import Body, Joint, Physics

GRAVITY = 9.81
"""[m/s^2]."""
CONTACT_RATE = 100.0
"""Natural frequency of contacts [rad/s]; stable by a wide margin at a 2 ms step."""
MOST_DAMPED = 1.2
"""Maximum damping ratio."""
TORSION_M = 0.003
"""Torsional friction: 2/3 of the radius of a contact patch of 4.5 mm [m]."""
ROLLING_M = 0.0001
"""Rolling friction, MuJoCo's default [m]."""
HOLD = 1.5
"""Dry joint friction over the largest gravity load."""
DAMPING_S = 0.05
"""Viscous damping divided by dry friction [s/rad or s/m]: at 1 rad/s it adds 5 %."""
SLIDER_FRICTION = 0.2
"""Friction coefficient of drawer rails."""


def solref(restitution: float) -> tuple[float, float]:
    """MuJoCo `solref` (time constant [s], damping ratio) for a coefficient of restitution in 0..1."""
    low, high = 1e-3, MOST_DAMPED
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if bounce(middle) > restitution else (low, middle)
    return 1.0 / (CONTACT_RATE * high), high


def bounce(damping_ratio: float) -> float:
    """Coefficient of restitution of a damped spring that cannot pull; decreases with the damping ratio > 0."""
    z = damping_ratio
    root = math.sqrt(abs(1.0 - z * z))
    if root < 1e-6:
        return math.exp(-2.0)
    if z < 1.0:
        return math.exp(-z * (math.pi - 2.0 * math.asin(z)) / root)
    return math.exp(-z / root * math.log((z + root) / (z - root)))


def friction(sliding: float) -> tuple[float, float, float]:
    """Sliding (no unit), torsional [m] and rolling [m] friction of a MuJoCo geom."""
    return sliding, TORSION_M, ROLLING_M


def joint_friction(joint: Joint, body: Body, physics: Physics) -> tuple[float, float]:
    """`frictionloss` [N m or N] and `damping` [N m s/rad or N s/m] that hold the joint against gravity."""
    carried = carried_links(joint.child, body)
    axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
    load = 0.0
    for name in carried:
        weight = physics.links[name].mass_kg * GRAVITY
        if joint.type == "prismatic":
            load += weight * (abs(float(axis[2])) + SLIDER_FRICTION / HOLD)
            continue
        arm = np.subtract(physics.links[name].centre, joint.origin)
        load += weight * float(np.linalg.norm(arm - axis * (arm @ axis)))
    return HOLD * load, HOLD * load * DAMPING_S


def carried_links(link: str, body: Body) -> list[str]:
    """`link` and all its descendants."""
    found = [link]
    for name in found:
        found += [joint.child for joint in body.joints if joint.parent == name]
    return found
