"""A policy as its server sees it: what it promises, and the answers of one episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.policy import SEEN, Channel, Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError, listing
from dextera_build.policy import cameras, instruction
from dextera_build.policy import contract as contracts
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.layout import WORLD, Layout, of_bundle
from dextera_build.policy.observation import DeployableObservation, Frame
from dextera_build.policy.running import Policy, Runner
from dextera_build.policy.wire.promise import Input, Promise

_ROWS = {name: name for name in ("joints", "objects", "displacement", "goal")} | {WORLD: "worlds"}
"""Channel -> the field of a layout that a contract may narrow."""


class Served:
    """A trained policy that can be asked on behalf of several programs, each in an episode of its own.

    Args:
        runner: The module `policy.py` of the algorithm that trained it.
        checkpoint: Weights and contract.
        digest: Digest of the checkpoint.
        bundle: A task that it fits.
        terms: Terms of observations that do not come with dxb.

    Raises:
        RuleError: The policy does not fit the task, its weights are corrupt, or it gives no joint targets.
    """

    def __init__(
        self, runner: Runner, checkpoint: Checkpoint, digest: str, bundle: TaskBundle, terms: Sequence[TermSpec] = ()
    ) -> None:
        self.contract = checkpoint.contract
        self._runner, self._checkpoint, self._bundle = runner, checkpoint, bundle
        self._layout = _narrowed(of_bundle(bundle, terms=terms), checkpoint)
        limits = [(joint.lower, joint.upper) for joint in bundle.robot.joints]
        self._limits = np.array(limits)
        contract, settings = self.contract, self.contract.settings
        self.promise = Promise(
            policy=digest,
            algorithm=contract.algorithm,
            task=contract.task,
            instruction=instruction.of_task(bundle.task),
            embodiment=contract.embodiment,
            rate_hz=contract.rate_hz,
            inputs=tuple(_input(channel, self._layout) for channel in contract.inputs),
            joints=contract.action.names,
            limits=tuple(limits),
            horizon=self._horizon(),
            every=int(settings.get("every", 1)),
            history=contract.history,
            forget=float(settings.get("forget", 0.0)),
        )

    def policy(self) -> Policy:
        """The policy at the start of an episode, with a state of its own."""
        return Policy(self.contract, self._layout, self._runner.predict(self._checkpoint, self._bundle), self._limits)

    def _horizon(self) -> int:
        """Number of steps that it predicts at once, by one prediction for an observation of zeros."""
        zeros = {channel.name: np.zeros(channel.shape, _dtype(channel)) for channel in self.contract.inputs}
        chunk = self.policy().chunk(*observations(self.contract.inputs, zeros))
        if chunk.ndim != 2 or chunk.shape[1] != len(self.contract.action.names):
            raise RuleError(
                f"`policy.py` of `{self.contract.algorithm}` gives {chunk.shape}, no table of steps and joints",
                code="DXB-B546",
                facts={"joints": len(self.contract.action.names)},
            )
        return len(chunk)


class Episode:
    """The requests of one connection.

    Args:
        served: The policy.
    """

    def __init__(self, served: Served) -> None:
        self._served = served
        self._policy = served.policy()

    def answer(self, request: object) -> dict[str, Any]:
        """The answer to a request: `actions` (C, A) float64 [rad or m], or nothing if it only begins an episode.

        Raises:
            RuleError: The request does not have the inputs that were promised, or the policy gives no targets.
        """
        if not isinstance(request, Mapping):
            raise RuleError(
                f"a request is a map of arrays, not a {type(request).__name__}",
                code="DXB-B547",
                facts={"keys": listing(self._names())},
            )
        reset = self._served.promise.reset
        if request.get(reset):
            self._policy.reset()
            if request.keys() == {reset}:
                return {}
        seen = observations(self._served.contract.inputs, request, self._served.promise.history)
        return {"actions": self._policy.chunk(*seen)}

    def _names(self) -> list[str]:
        return [channel.name for channel in self._served.contract.inputs]


def observations(
    channels: Sequence[Channel], request: Mapping[Any, Any], history: int = 1
) -> list[DeployableObservation]:
    """The observations in a request, the present one last; further keys of it, such as `prompt`, are not read.

    Args:
        channels: What each observation has.
        request: Channel -> its array, or those of several steps along an additional first axis.
        history: Most steps that a request may hold.

    Raises:
        RuleError: A channel is missing, or has another shape or type.
    """
    missing = [channel.name for channel in channels if channel.name not in request]
    if missing:
        raise RuleError(
            f"a request lacks {listing(missing)}",
            code="DXB-B547",
            facts={"needed": listing([channel.name for channel in channels]), "given": listing(map(str, request))},
        )
    given = {channel.name: _checked(channel, request[channel.name], history) for channel in channels}
    steps = {name: len(array) for name, array in given.items()}
    if len(set(steps.values())) > 1:
        raise RuleError("the channels of a request hold different numbers of steps", code="DXB-B547", facts=steps)
    return [_observation({name: array[row] for name, array in given.items()}) for row in range(min(steps.values()))]


def _observation(values: dict[str, np.ndarray]) -> DeployableObservation:
    frames: dict[str, dict[str, np.ndarray]] = {}
    for name in filter(cameras.is_seen, list(values)):
        frames.setdefault(cameras.camera_of(name), {})[cameras.term_of(name)] = values.pop(name)
    return DeployableObservation(values, {camera: Frame(**seen) for camera, seen in frames.items()})


def _checked(channel: Channel, value: object, history: int) -> np.ndarray:
    """The steps of a channel (K, ...)."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.zeros(0, object)
    fits = array.dtype == np.uint8 if channel.encoding == "picture" else array.dtype.kind in "biuf"
    steps = array[None] if array.ndim == len(channel.shape) else array
    if steps.shape[1:] != channel.shape or not 0 < len(steps) <= history or not fits:
        raise RuleError(
            f"`{channel.name}` is {array.shape} {array.dtype}, the policy takes {channel.shape} {_dtype(channel)}",
            code="DXB-B547",
            facts={"components": listing(channel.names, most=40)} if channel.names else None,
        )
    return steps.astype(_dtype(channel))


def _dtype(channel: Channel) -> np.dtype[Any]:
    return np.dtype(np.uint8 if channel.encoding == "picture" else np.float32)


def _narrowed(layout: Layout, checkpoint: Checkpoint) -> Layout:
    """The layout with no more objects and joints than the policy takes, because a request holds just these.

    Raises:
        RuleError: The policy does not fit the task.
    """
    taken = {channel.name: channel for channel in checkpoint.contract.inputs}
    rows = {field: taken[name].names for name, field in _ROWS.items() if name in taken and taken[name].names}
    looks = checkpoint.contract.seen
    seen = replace(layout, cameras={cameras.camera_of(each.name): cameras.shown_in(each) for each in looks})
    contracts.refuse_teacher(checkpoint.contract)
    contracts.refuse(contracts.differences(checkpoint.contract, seen))
    return replace(seen, **rows)  # type: ignore[arg-type]


def _input(channel: Channel, layout: Layout) -> Input:
    """What a request holds for a channel."""
    if channel.encoding == "picture":
        return Input(name=channel.name, shape=channel.shape, dtype="uint8", unit="sRGB 0..255")
    if channel.encoding in SEEN:
        term = BY_NAME[cameras.term_of(channel.name)]
        return Input(name=channel.name, shape=channel.shape, dtype="float32", unit=f"{term.unit}; {term.about}")
    declared = layout.channel(channel.name)
    unit = "1 for the kind of the world, else 0" if channel.name == WORLD else declared.unit if declared else ""
    return Input(name=channel.name, shape=channel.shape, dtype="float32", names=channel.names, unit=unit)
