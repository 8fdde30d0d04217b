"""A scripted operator in a world other than the twin, acting on measurements."""

from __future__ import annotations

import numpy as np

from dextera_build.policy.observation import DeployableObservation, Measurement
from dextera_build.policy.running import PolicyFault
from dextera_build.sim.control.operator import Command, GaveUp, Operator, PoseControl
from dextera_build.sim.experts.drive import Driver, state_of
from dextera_build.sim.runtime.reconstruction import Tracker, reconstruct


class Deployed:
    """Makes a policy from an operator: its commands are converted to joint targets by inverse kinematics.

    The operator plans in the twin, which is set to the first observation of an episode; later it receives measured
    joints and objects. After its last command, the targets are held.

    Args:
        twin: Driver of the task in the twin; its environment is used and left in an arbitrary state.
        operator: Operator that was rehearsed there.
    """

    def __init__(self, twin: Driver, operator: Operator) -> None:
        self._twin, self._operator = twin, operator
        bundle = twin.environment.bundle
        self._control = PoseControl(bundle.robot, bundle.task.control_hz)
        self.reset()

    def reset(self) -> None:
        """Forget the previous episode."""
        self._last: Command | None = None
        self._begun = False

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad].

        Raises:
            PolicyFault: The operator has no plan from the first observation, or its grasp failed.
        """
        if not self._begun:
            self._begin(observation)
        try:
            now = self._operator.command(state_of(self._twin.environment.bundle, _measured(observation)))
        except GaveUp as verdict:
            raise PolicyFault(str(verdict), code="DXB-B256") from None
        self._last = now or self._last
        if self._last is None:
            raise PolicyFault("the operator did nothing", code="DXB-B254")
        return self._control.follow(self._last)

    def _begin(self, observation: DeployableObservation) -> None:
        """Plan in the twin from the measured state."""
        environment, sent = self._twin.environment, np.asarray(observation["previous_action"], np.float64)
        environment.begin(reconstruct(_measured(observation), sent, environment, Tracker(), 0))
        try:
            self._operator.begin(self._twin.state())
        except GaveUp as verdict:
            raise PolicyFault(str(verdict), code="DXB-B255") from None
        self._control.begin(sent)
        self._begun = True


def _measured(observation: DeployableObservation) -> Measurement:
    return Measurement(
        observation["joints"].astype(np.float64),
        observation["objects"].astype(np.float64),
        observation["displacement"].astype(np.float64),
    )
