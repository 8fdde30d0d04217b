"""From the vector of a fit to named estimates, and from what a twin states to the prior of a fit."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate, Estimate, JointDynamics, ObjectDynamics
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.layout import embodiment
from dextera_build.sim.runtime.starts import GAINS
from dextera_build.statistics import Z90

from .arm import Arm, Run, Values
from .fit import Fit, Layout, Prior

LAG_SIGMA = 0.3
"""Standard deviation of the logarithm of a joint's lag, of which the twin states none."""
FRICTION_SIGMA = 0.03
"""That of a joint's dry friction, as a fraction of its maximum torque."""
LATENCY_SIGMA = 0.03
"""That of the latency [s]."""
CENTRE_SIGMA = 0.01
"""That of the centre of mass of what is carried: shape, tracker and its delay [m]."""
LIFTED_SIGMA = 0.1
"""That of the fraction of its weight that a pushing hand takes off the support."""
SHARED = 0.025
"""Standard deviation of errors of logarithms that all recordings share, because a simulated arm is not the robot;
chosen on the perturbed worlds with seeds 0 to 2."""

RUBBED = 0.08
"""The same of friction, as a fraction: an object that is pushed rattles, and is not always pressed on its support."""


def prior_of(bundle: TaskBundle, arm: Arm, mass: tuple[float, float] | None = None) -> Prior:
    """What the twin states, and what is generally assumed.

    Args:
        bundle: The task in the twin.
        arm: Its arms.
        mass: Mass of the object [kg] and the standard deviation of its logarithm, if it was weighed.
    """
    count, layout = len(arm.joints), Layout(len(arm.joints))
    thing = bundle.objects[bundle.task.object]
    low, high = thing.mass_scale
    log_mass, mass_sigma = math.log(low * high) / 2, max(math.log(high / low) / (2 * Z90), 1e-3)
    if mass is not None:
        log_mass, mass_sigma = math.log(mass[0] / arm.payload.mass_kg), mass[1]
    mean = layout.vector(
        Values(
            log_stiffness=np.zeros(count),
            log_lag=np.zeros(count),
            friction=arm.friction,
            latency_s=bundle.latency_s,
            log_mass=log_mass,
            mu=thing.friction,
        )
    )
    share = [bundle.gain_share.get(joint.name, 1.0) for joint in arm.joints]
    common = [LATENCY_SIGMA, mass_sigma, *[CENTRE_SIGMA] * 3, max(thing.friction_sigma, 1e-3), LIFTED_SIGMA]
    blocks = [GAINS / math.sqrt(3.0) * np.array(share), np.full(count, LAG_SIGMA), np.full(count, FRICTION_SIGMA)]
    return Prior(mean, np.concatenate([*blocks, common]))


@dataclass(frozen=True)
class Gate:
    """Turns the quantities of a fit into estimates, or keeps what the twin states."""

    stated: Prior
    """What the twin states and what is generally assumed, without scales."""
    found: Fit
    narrower: float
    """Largest standard deviation of what is identified, as a fraction of that before."""

    def passed(self, index: int, unit: float, shared: float, *, log: bool = False, why: str = "") -> Estimate:
        """The estimate of a quantity.

        Args:
            index: Its place in the vector.
            unit: What the number there is a factor on, or the logarithm of such a factor.
            shared: Standard deviation of errors that all recordings share, in the unit of the vector.
            log: Whether it is a logarithm.
            why: Why it cannot be identified anyway.
        """
        size = 1.0 if log else unit
        now = size * math.hypot(math.sqrt(self.found.covariance[index, index]), shared)
        before = size * float(self.stated.sigma[index])
        value, prior = (
            unit * (math.exp(vector[index]) if log else float(vector[index]))
            for vector in (self.found.values, self.stated.mean)
        )
        if not why and now > self.narrower * before:
            why = f"its standard deviation would be {now:.2g} after {before:.2g}"
        if why:
            return Estimate(value=prior, sigma=before, prior=prior, prior_sigma=before, why=why)
        return Estimate(value=value, sigma=now, prior=prior, prior_sigma=before)


def estimated(
    bundle: TaskBundle, arm: Arm, runs: Sequence[Run], found: Fit, narrower: float, *, weighed: bool
) -> DynamicsEstimate:
    """The estimates, those that are not identified as the twin states them.

    Args:
        bundle: The task in the twin.
        arm: Its arms.
        runs: The recordings.
        found: The fit.
        narrower: See `Gate`.
        weighed: Whether the mass was weighed.
    """
    layout, gate = Layout(len(arm.joints)), Gate(prior_of(bundle, arm), found, narrower)
    periods = {name: sum(_count(run, name) for run in runs) for name in ("free", "carried", "pushed")}
    contact = "" if periods["carried"] or periods["pushed"] else _reason(runs)
    pushed = "" if periods["pushed"] else contact or "the object was carried and never pushed"
    mass, mu = layout.common("log_mass"), layout.common("mu")
    thing = ObjectDynamics(
        mass_kg=gate.passed(
            mass, arm.payload.mass_kg, 0.0 if weighed else SHARED, log=True, why="" if weighed else contact
        ),
        friction=gate.passed(mu, 1.0, RUBBED * float(found.values[mu]), why=pushed),
    )
    return DynamicsEstimate(
        task=bundle.task.name,
        embodiment=embodiment(bundle.robot),
        objects={bundle.task.object: thing},
        joints={joint.name: _joint(gate, arm, layout, number) for number, joint in enumerate(arm.joints)},
        latency_s=gate.passed(layout.common("latency_s"), 1.0, float(arm.model.opt.timestep) / 2),
        periods=periods,
        runs=len(runs),
        residual=found.residual,
    )


def _joint(gate: Gate, arm: Arm, layout: Layout, number: int) -> JointDynamics:
    stiffness, lag_s, friction = (layout.block(block).start + number for block in range(3))
    lag = float(arm.lags[number])
    return JointDynamics(
        stiffness=gate.passed(stiffness, float(arm.stiffness[number]), SHARED, log=True),
        # A lag is known to half a step of the simulation, which is another one in another simulation.
        lag_s=gate.passed(lag_s, lag, float(arm.model.opt.timestep) / 2 / lag, log=True),
        friction=gate.passed(friction, arm.joints[number].effort, SHARED * float(gate.found.values[friction])),
    )


def _count(run: Run, name: str) -> int:
    part = getattr(run.phases, name)
    return 0 if part is None else int(part.sum())


def _reason(runs: Sequence[Run]) -> str:
    """The most frequent reason why contact tells nothing."""
    return Counter(run.phases.why for run in runs).most_common(1)[0][0]
