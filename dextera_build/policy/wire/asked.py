"""A policy that another process or machine runs, as a checkpoint and as the network that is asked behind an address."""

from __future__ import annotations

import json
import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.policy.features import Fields
from dextera_build.policy.running import PolicyFault, Predict
from dextera_build.policy.wire import link
from dextera_build.policy.wire.promise import Promise
from dextera_build.policy.wire.said import connected

NO_WEIGHTS = (2).to_bytes(8, "little") + b"{}"
"""A safetensors file without tensors."""
Settings = dict[str, float | int | str | bool]
"""Settings of a contract that `Asked` needs."""


def elsewhere(contract: PolicyContract) -> Checkpoint:
    """The checkpoint of a policy that another process or machine runs."""
    return Checkpoint(
        weights=NO_WEIGHTS,
        contract=contract,
        steps=np.zeros(0, np.int64),
        curve=np.zeros(0, np.float32),
        curve_name="trained elsewhere",
    )


def stated(promise: Promise, digest: str, settings: Settings) -> PolicyContract:
    """The contract that a server of dxb states.

    Args:
        promise: What the policy takes and gives.
        digest: Digest of the message with the promise.
        settings: Of `promised`.
    """
    return PolicyContract(
        algorithm="served",
        task=promise.task,
        embodiment=promise.embodiment,
        inputs=tuple(each.channel() for each in promise.inputs),
        action=Channel(name="action", shape=(len(promise.joints),), names=promise.joints),
        rate_hz=promise.rate_hz,
        dataset=digest,
        settings=settings,
    )


def promised(promise: Promise, address: str, key_in: str, first_s: float, answer_s: float) -> Settings:
    """How a policy of a server of dxb is asked.

    Args:
        promise: What the policy takes and gives.
        address: Its address.
        key_in: Environment variable that holds the server's key; empty: it asks for none.
        first_s: Time limit of the first answer on a connection [s].
        answer_s: Time limit of every other answer [s].
    """
    return {
        "address": address,
        "horizon": promise.horizon,
        "every": promise.every,
        "history": promise.history,
        "used": promise.horizon,
        "forget": promise.forget,
        "reset": promise.reset,
        "keys": "{}",
        "instruction": "",
        "instruction_key": "",
        "unnorm_key": "",
        "key_in": key_in,
        "first_s": first_s,
        "answer_s": answer_s,
        "revision": "",
    }


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """A connection to the policy, which is opened anew after a fault."""
    return Asked(checkpoint.contract)


class Asked:
    """A policy behind an address.

    Args:
        contract: Of a checkpoint of `elsewhere`.

    Raises:
        MachineError: Nothing answers there.
        RuleError: Another policy answers.
    """

    def __init__(self, contract: PolicyContract) -> None:
        self._contract = contract
        self._set: dict[str, Any] = dict(contract.settings)
        self._keys = json.loads(self._set["keys"])
        self._open()

    def _open(self) -> None:
        self._link, said = connected(self._set["address"], self._set["key_in"])
        self._close = weakref.finalize(self, self._link.close)
        self._limit_s = self._set["first_s"]
        if said.digest != self._contract.dataset:
            self._close()
            raise RuleError(
                f"another policy answers at `{self._set['address']}` than when this node was built",
                code="DXB-B545",
                facts={"built with": self._contract.dataset[:12], "answers": said.digest[:12]},
                hint="`dxb build --force NODE` of learn.served takes the new one; trials then run again",
            )

    def __call__(self, inputs: Fields, step: int) -> np.ndarray:
        """Joint targets (C, A) for this step and those after it [rad].

        Args:
            inputs: One sample of each channel, or as many as the policy's history has.
            step: Steps since the start of the episode.

        Raises:
            PolicyFault: There is no usable answer; the next call connects anew.
        """
        if not self._close.alive:
            self._open()
        request = self._request(inputs)
        if self._set["reset"] and step == 0:
            request[self._set["reset"]] = True
        try:
            chunk = self._chunk(self._link.ask(request, self._limit_s))
        except PolicyFault:
            self._close()
            raise
        self._limit_s = self._set["answer_s"]
        return chunk

    def _request(self, inputs: Fields) -> dict[str, Any]:
        request: dict[str, Any] = {}
        steps = (self._set["history"],) if self._set["history"] > 1 else ()
        for channel in self._contract.inputs:
            array = np.ascontiguousarray(inputs[channel.name]).reshape((*steps, *channel.shape))
            request[self._keys.get(channel.name, channel.name)] = array
        if self._set["instruction"]:
            request[self._set["instruction_key"]] = self._set["instruction"]
        if self._set["unnorm_key"]:
            request["unnorm_key"] = self._set["unnorm_key"]
        return request

    def _chunk(self, answer: Mapping[str, Any]) -> np.ndarray:
        address, horizon, joints = self._set["address"], self._set["horizon"], self._contract.action.shape[0]
        actions = answer.get("actions")
        if actions is None:
            raise link.unusable(address, "has no `actions`", keys=listing(map(str, answer)) or "none")
        try:
            chunk = np.atleast_2d(np.asarray(actions))
        except ValueError:  # rows of different lengths
            chunk = np.zeros(0, object)
        if chunk.ndim != 2 or chunk.dtype.kind not in "iuf":
            raise link.unusable(address, "holds no table of numbers in `actions`", found=f"{chunk.shape} {chunk.dtype}")
        if chunk.shape[1] != joints:
            what = f"has {chunk.shape[1]} numbers a step, the robot has {joints} joints"
            raise link.unusable(address, what, "absolute targets of all joints are expected", joints=joints)
        if len(chunk) != horizon:
            what = f"has {len(chunk)} steps, {horizon} were expected"
            raise link.unusable(address, what, f"`horizon: {len(chunk)}`", horizon=horizon)
        return chunk[: self._set["used"]].astype(np.float64)
