"""Answers calls: from the store, from a remote, or from the service itself, whose answer is then recorded.

A recorded call is stored as a node's result is, under the digest of its request: the output is a `File` with the body,
the key document is the request, and the metrics are its time, tokens and cost.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from typing_extensions import Unpack

from dextera_build.calls import Job, JobManner, Response
from dextera_build.calls.asking import Manner, Send, amounts, ask
from dextera_build.calls.gate import Emit, Gate
from dextera_build.calls.jobs import Run
from dextera_build.calls.question import Question, question
from dextera_build.calls.services import usd
from dextera_build.calls.terms import Terms
from dextera_build.errors import RuleError, StoreError
from dextera_build.store import headers
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

How: TypeAlias = Literal["replayed", "fetched", "asked", "confirmed", "diverged", "replaced"]
Fetch: TypeAlias = Callable[[str], ActionResult | None]
"""Key -> the result from a remote, or None."""


@dataclass(frozen=True)
class _Answered:
    """A new answer."""

    response: Response
    seconds: float
    """Duration of the try that succeeded, or of the job [s]."""
    cost: float | None
    """Cost of all tries [USD]."""


class Recorder:
    """The calls of one node.

    Args:
        store: Where answers are recorded.
        mode: `record`: replay recorded answers, send the other requests. `replay`: send nothing. `refresh`: send
            everything again and compare; the first answer stays. `replace`: as `refresh`, but the new answer stays.
            `off`: make no calls.
        fetch: Looks up a recorded answer in remotes; None without remotes.
        emit: Takes `log` lines about each call, `progress` of jobs, and as `grace` the time that a worker needs to end;
            see `Gate` for `paid`.
        terms: Limits and prices of services, and the limit of costs.
    """

    def __init__(
        self,
        store: Store,
        mode: str,
        fetch: Fetch | None = None,
        emit: Emit = lambda kind, data: None,
        terms: Terms | None = None,
    ) -> None:
        self._store, self._mode, self._fetch, self._emit = store, mode, fetch, emit
        self._terms = terms or Terms()
        self.made: list[dict[str, Any]] = []
        """The calls, in order: `call`, `result`, `service`, `model`, `how`, `seconds` and amounts."""

    def __call__(self, service: str, request: object, send: Send | Job, **manner: Unpack[JobManner]) -> bytes:
        """The body of the answer; see `Context.call`, and `Context.job` for a `Job` in place of a function."""
        return self._answer(service, request, send, Manner.of(manner))

    def _answer(self, service: str, request: object, send: Send | Job, manner: Manner) -> bytes:
        asked = question(service, request, manner.secrets, manner.data)
        if self._mode == "off":
            raise RuleError(
                f"a rule wants to call `{asked.shown}`, and calls are off",
                code="DXB-B341",
                facts=asked.facts(),
                hint="profile `stub` never calls; else `--calls record` asks, `--calls replay` uses recorded answers",
            )
        found = self._known(asked) if self._mode in ("record", "replay") else None
        if found is None:
            if self._mode == "replay":
                raise RuleError(
                    f"no answer of `{asked.shown}` to this request is recorded, and nothing may be asked",
                    code="DXB-B340",
                    facts=asked.facts(),
                    hint="`--calls record` asks; `--cache local:rw,NAME:r` or `dxb bundle import` gets answers",
                )
            # Concurrent callers with the same request wait here, and then find the answer.
            with self._store.locks.hold(asked.key):
                found = self._settle(asked, send, manner)
        body, result, how = found
        self._store.blobs.put(result.document)  # the node's result refers to it, here and in other stores
        self._note(asked, result, how)
        return body

    def _settle(self, asked: Question, send: Send | Job, manner: Manner) -> tuple[bytes, ActionResult, How]:
        known = self._known(asked, elsewhere=self._mode != "record")  # `record` has searched remotes before
        if known is not None and self._mode == "record":
            return known
        gate = Gate(asked, self._terms, self._store.local / "services", self._emit)
        if isinstance(send, Job):
            with gate.slot():
                folder = self._store.keep.path(asked.key)
                response, seconds = Run(asked, gate.job(send), manner, folder, self._emit).answer()
        else:
            response, seconds = ask(asked, gate.call(send), gate.mending(manner), self._log)
        settled = self._compared(asked, known, _Answered(response, seconds, gate.cost))
        self._store.keep.drop(asked.key)
        return settled

    def _compared(
        self, asked: Question, known: tuple[bytes, ActionResult, How] | None, answered: _Answered
    ) -> tuple[bytes, ActionResult, How]:
        """Record a new answer, or compare it with the one that is known."""
        response = answered.response
        if known is None:
            return response.body, self._publish(asked, answered), "asked"
        body, first, _ = known
        if body == response.body:
            return body, first, "confirmed"
        if self._mode == "replace":
            return response.body, self._publish(asked, answered), "replaced"
        other = self._kept(response.body)
        self._store.divergent.note(asked.key, f"call {asked.shown}", first.output, other, time.time())
        return body, first, "diverged"

    def _known(self, asked: Question, *, elsewhere: bool = True) -> tuple[bytes, ActionResult, How] | None:
        result = self._store.actions.get(asked.key)
        how: How = "replayed"
        if result is None and elsewhere and self._fetch is not None:
            result, how = self._fetch(asked.key), "fetched"
        if result is None:
            return None
        try:
            return body_of(self._store, result), result, how
        except MissingBlob:
            return None  # damaged, and moved to quarantine

    def _publish(self, asked: Question, answered: _Answered) -> ActionResult:
        response = answered.response
        blobs, found = self._store.blobs, amounts(response.body)
        metrics = {
            "asked": (round(time.time(), 3), "s since 1970"),
            "status": (float(response.status), ""),
            "request": (float(asked.octets), "bytes"),
            "answer": (float(len(response.body)), "bytes"),
            **found,
            **({"cost": (answered.cost, "USD")} if answered.cost is not None else {}),
        }
        output, document = self._kept(response.body), blobs.put(asked.document)
        result = ActionResult(output, f"call {asked.shown}", (), metrics, round(answered.seconds, 6), None, document)
        self._store.actions.put(asked.key, result)
        return result

    def _kept(self, body: bytes) -> str:
        """Store these bytes as a `File` and return its digest."""
        return self._store.blobs.put(headers.file_header(self._store.blobs.put(body), len(body)))

    def _log(self, text: str) -> None:
        self._emit("log", {"text": text})

    def _note(self, asked: Question, result: ActionResult, how: How) -> None:
        said = {name: value for name, (value, _) in result.metrics.items() if name in ("total_tokens", "cost")}
        row = {"call": asked.key, "result": result.digest, "service": asked.service, "model": asked.model, "how": how}
        self.made.append(row | {"seconds": result.seconds} | said)
        cost = f", {usd(said['cost'])}" if "cost" in said and how not in ("replayed", "fetched") else ""
        self._log(f"call {asked.key[:12]}: {asked.shown}, {how}{cost}, {asked.octets:,} bytes asked")


def body_of(store: Store, result: ActionResult) -> bytes:
    """The body that a recorded call holds.

    Raises:
        MissingBlob: It is not in the store.
        StoreError: The result is not a recorded call.
    """
    _, blobs = headers.closure(store.blobs.get(result.output))
    if len(blobs) != 1:
        raise StoreError(f"`{result.key_document[:12]}` is not a recorded call", code="DXB-B349")
    return store.blobs.get(blobs[0])


def of(store: Store, key: str) -> tuple[Mapping[str, Any], ActionResult] | None:
    """The request and the result of a recorded call, or None if `key` is not one."""
    result = store.actions.get(key)
    if result is None:
        return None
    document = json.loads(store.blobs.get(result.key_document))
    return (document, result) if "call" in document and "service" in document else None
