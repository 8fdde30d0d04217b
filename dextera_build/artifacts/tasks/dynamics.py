"""What recordings of a robot tell about the dynamics of its twin."""

from __future__ import annotations

from dextera_build.artifacts.base import Artifact, Value


class Estimate(Value):
    """A quantity before and after the recordings were seen."""

    value: float
    """Estimate; what the twin states if it was not identified."""
    sigma: float
    """Its standard deviation; of its logarithm for a mass, a stiffness and a lag."""
    prior: float
    """What the twin states."""
    prior_sigma: float
    """The standard deviation of that, as for `sigma`."""
    why: str = ""
    """Why it cannot be identified from these recordings; empty if it was."""

    @property
    def identified(self) -> bool:
        """Whether the recordings determine it."""
        return not self.why


class ObjectDynamics(Value):
    """An object of the task."""

    mass_kg: Estimate
    """Mass with all its links [kg]."""
    friction: Estimate
    """Sliding friction coefficient of object and support."""


class JointDynamics(Value):
    """A joint with its position controller: torque = stiffness (target - position) - damping velocity."""

    stiffness: Estimate
    """Stiffness [N m/rad or N/m]."""
    lag_s: Estimate
    """Damping / stiffness, by which the joint lags behind a moving target [s]."""
    friction: Estimate
    """Dry friction [N m or N]."""


class DynamicsEstimate(Artifact):
    """Mass and friction of a task's object and the controllers of its robot, estimated from recordings of a robot."""

    task: str
    """Name of the task."""
    embodiment: str
    """Digest of joint names and limits, see `dextera_build.policy.layout`."""
    objects: dict[str, ObjectDynamics]
    """Root body -> its estimates; of the task's object alone."""
    joints: dict[str, JointDynamics]
    """Joint of an arm -> its estimates."""
    latency_s: Estimate
    """Time from a command to its effect [s]."""
    periods: dict[str, int]
    """`free`, `carried`, `pushed` -> number of control periods that were used."""
    runs: int
    """Number of recordings that were used."""
    residual: float
    """Root mean square of what the simulated arm leaves unexplained of the joints [rad or m]."""

    @property
    def estimates(self) -> dict[str, Estimate]:
        """All estimates by what they are of: `mass_kg of mug`."""
        parts = {**{f"of {name}": each for name, each in self.objects.items()}, **self.joints}
        found = {
            f"{field} {of}" if of.startswith("of ") else f"{field} of {of}": estimate
            for of, each in parts.items()
            for field, estimate in each
        }
        return {**found, "latency_s": self.latency_s}
