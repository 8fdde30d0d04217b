"""Convert physics artifacts to MuJoCo contact and joint parameters.

**Restitution.** A MuJoCo contact is a damped spring that pushes and never pulls. For a damping ratio z < 1 it returns
the speed times e = exp(-z (pi - 2 asin z) / sqrt(1 - z^2)), for z > 1 times exp(-z / r ln((z + r) / (z - r))) with r =
sqrt(z^2 - 1) (Schwager and Poeschel 2007); z = 1 gives e^-2. `solref` takes (time constant, z); the natural frequency
is 1 / (time constant * z) and is kept at `CONTACT_RATE` for every e, so bouncy objects are no stiffer than others.
Damping is limited to `MOST_DAMPED` (e = 0.11), because above 1.6 resting bodies chatter at a 2 ms step. A body with
slight initial penetration is pushed out slowly.

**Stiffness.** The natural frequency of an object of mass m on a surface of stiffness k is sqrt(k / m), so its impact
takes pi / sqrt(k / m). This value is used between `SOFTEST` and `STIFFEST` rad/s; a stiffer surface would need a
shorter step. At rest MuJoCo's contacts carry most of the weight without deflection, so a soft object does not sink in.

**Friction.** Sliding friction is the body's own. Object geoms have priority 1, the static scene 0, so the object's
parameters take precedence over the table's; between two objects MuJoCo uses the larger friction. Torsional and rolling
friction are lengths [m], from the radius of a small contact patch.

**Joints.** A joint that holds its position in the photograph has at least the dry friction to resist gravity. `HOLD`
times the largest gravity load between the limits matches laptop hinges: they hold, and a hand moves them. Gravity
exerts no torque on a door with a vertical axis: such a joint has only the friction of its bearing, `BEARING_M` times
the weight.
"""

from __future__ import annotations

import math

import numpy as np

from dextera_build.artifacts.objects.object import Body, Joint, Physics
from dextera_build.geometry import kinematics

GRAVITY = 9.81
"""[m/s^2]."""
CONTACT_RATE = 100.0
"""Natural frequency of contacts [rad/s]; stable by a wide margin at a 2 ms step."""
SOFTEST, STIFFEST = 50.0, 200.0
"""Limits of the natural frequency [rad/s]: softer bodies rest deeper than 0.4 mm, stiffer ones bounce too little at a
step of 2 ms."""
MOST_DAMPED = 1.2
"""Maximum damping ratio."""
TORSION_M = 0.003
"""Torsional friction: 2/3 of the radius of a contact patch of 4.5 mm [m]."""
ROLLING_M = 0.0001
"""Rolling friction, MuJoCo's default [m]."""
HOLD = 1.5
"""Dry joint friction relative to the largest gravity load."""
DAMPING_S = 0.05
"""Viscous damping divided by dry friction [s/rad or s/m]: at 1 rad/s it adds 5 %."""
SLIDER_FRICTION = 0.2
"""Friction coefficient of drawer rails."""
BEARING_M = 0.001
"""Dry friction of a hinge relative to the weight that it carries: friction coefficient times radius of the pin [m]."""
POSITIONS = 33
"""Number of positions between the limits at which the load is evaluated."""


def solref(restitution: float, stiffness: float | None = None, mass: float = 0.0) -> tuple[float, float]:
    """MuJoCo `solref` (time constant [s], damping ratio) for a coefficient of restitution in 0..1.

    Args:
        restitution: Coefficient of restitution of the object.
        stiffness: Stiffness of its surface [N/m]; None: a natural frequency of `CONTACT_RATE`.
        mass: Mass of the whole object [kg].
    """
    rate = CONTACT_RATE if stiffness is None else min(max(math.sqrt(stiffness / mass), SOFTEST), STIFFEST)
    low, high = 1e-3, MOST_DAMPED
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if bounce(middle) > restitution else (low, middle)
    return 1.0 / (rate * high), high


def bounce(damping_ratio: float) -> float:
    """Coefficient of restitution of a damped spring that cannot pull; decreases with the damping ratio > 0."""
    z = damping_ratio
    root = math.sqrt(abs(1.0 - z * z))
    if root < 1e-6:
        return math.exp(-2.0)
    if z < 1.0:
        return math.exp(-z * (math.pi - 2.0 * math.asin(z)) / root)
    return math.exp(-z / root * math.log((z + root) / (z - root)))


LEAST_BOUNCE = bounce(MOST_DAMPED)
"""Coefficient of restitution of the most damped contact."""


def spring(restitution: float, stiffness: float | None, mass: float) -> tuple[float, float] | None:
    """Stiffness [N/m] and damping [N s/m] of a contact of an object of `mass` [kg]; None without a stiffness."""
    if stiffness is None:
        return None
    time, ratio = solref(restitution, stiffness, mass)
    rate = 1.0 / (time * ratio)
    return mass * rate * rate, 2.0 * ratio * mass * rate


def friction(sliding: float) -> tuple[float, float, float]:
    """Sliding (no unit), torsional [m] and rolling [m] friction of a MuJoCo geom."""
    return sliding, TORSION_M, ROLLING_M


def joint_friction(joint: Joint, body: Body, physics: Physics, down: np.ndarray | None = None) -> tuple[float, float]:
    """`frictionloss` [N m or N] and `damping` [N m s/rad or N s/m] that hold the joint against gravity.

    Args:
        joint: The joint.
        body: Its object.
        physics: Masses of the links.
        down: Unit direction of gravity in the object frame (3,); None: -z, as the object stands.
    """
    down = np.array([0.0, 0.0, -1.0]) if down is None else down
    carried = carried_links(joint.child, body)
    weight = GRAVITY * sum(physics.links[name].mass_kg for name in carried)
    axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
    if joint.type == "prismatic":
        load = HOLD * weight * abs(float(axis @ down))
        across = weight * float(np.linalg.norm(down - axis * (axis @ down)))
        friction = load + SLIDER_FRICTION * across
        return friction, friction * DAMPING_S
    friction = HOLD * _largest_torque(joint, carried, physics, axis, down) + BEARING_M * weight
    return friction, friction * DAMPING_S


def _largest_torque(joint: Joint, carried: list[str], physics: Physics, axis: np.ndarray, down: np.ndarray) -> float:
    """Largest torque of gravity about a hinge between its limits and its position [N m]."""
    moment = np.zeros(3)
    for name in carried:
        moment += physics.links[name].mass_kg * GRAVITY * np.subtract(physics.links[name].centre, joint.origin)
    low, high = min(joint.lower, joint.position), max(joint.upper, joint.position)
    turned = (kinematics.joint_motion(joint, angle)[:3, :3] @ moment for angle in np.linspace(low, high, POSITIONS))
    return max(abs(float(np.cross(arm, down) @ axis)) for arm in turned)


def carried_links(link: str, body: Body) -> list[str]:
    """`link` and all its descendants."""
    found = [link]
    for name in found:
        found += [joint.child for joint in body.joints if joint.parent == name]
    return found
