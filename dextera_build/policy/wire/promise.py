"""What a policy that dxb serves takes and gives: the first message of its server, readable by any client."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, Literal

from pydantic import ValidationError

from dextera_build.artifacts.base import Value
from dextera_build.artifacts.tasks.policy import Channel
from dextera_build.policy import cameras

WIRE: Final = "dxb/1"
RESET = "reset"
"""Key of a request with which an episode begins anew, if its value is true."""


class Input(Value):
    """One channel of the observations that a request holds."""

    name: str
    """Its key in a request."""
    shape: tuple[int, ...]
    """Shape of the array."""
    dtype: Literal["float32", "uint8"]
    """Type of the array."""
    names: tuple[str, ...] = ()
    """Names of its rows or components, in order: joints, objects, ..."""
    unit: str = ""
    """Unit of its numbers; poses are position and quaternion w x y z, in the robot's base frame."""

    def channel(self) -> Channel:
        """The channel of a contract; the server normalises."""
        encoding = cameras.TERMS.get(cameras.term_of(self.name), "plain")
        return Channel(name=self.name, shape=self.shape, names=self.names, encoding=encoding)


class Promise(Value):
    """The contract of a served policy."""

    wire: Literal["dxb/1"] = WIRE
    """Version of this message."""
    policy: str
    """Digest of the checkpoint."""
    algorithm: str
    """How it was trained: `act`."""
    task: str
    """Name of the task: `LiftMustardBottle`."""
    instruction: str
    """The task in words."""
    embodiment: str
    """Digest of names and limits of the robot's joints."""
    rate_hz: float
    """Control rate that it was trained at [Hz]."""
    inputs: tuple[Input, ...]
    """Channels of a request."""
    joints: tuple[str, ...]
    """Components of an action, joint targets [rad or m], in order."""
    limits: tuple[tuple[float, float], ...]
    """Lower and upper limit of each joint [rad or m]; `actions` may exceed them, who executes them clips."""
    horizon: int
    """Number of steps in `actions` of an answer."""
    every: int
    """Number of these steps to carry out before the next request."""
    history: int = 1
    """Number of steps that the policy sees at once. A request may hold them along an additional first axis, the present
    one last; a client that sends one step per request must ask at every step."""
    forget: float
    """Steps of overlapping answers are averaged with weights exp(-forget * i), i = 0 for the oldest answer."""
    reset: str = RESET
    """Key of a request that begins an episode; a new connection begins one, too."""

    def message(self) -> dict[str, Any]:
        """The promise as plain data."""
        return self.model_dump(mode="json")


def read(greeting: object) -> Promise | None:
    """The promise in a server's first message; None if another program sent it, or another version of dxb.

    Args:
        greeting: The message, unpacked.
    """
    if not isinstance(greeting, Mapping) or greeting.get("wire") != WIRE:
        return None
    try:
        return Promise.model_validate_json(json.dumps(greeting))
    except (ValidationError, TypeError):
        return None
