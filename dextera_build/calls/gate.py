"""Between a request and its service: the service's limits, the price of the request, and the limit of the command."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from dextera_build.calls import Job, JobState, Response
from dextera_build.calls.asking import MOST_RETRY_AFTER_S, Manner, Send, amounts, retry_after, was_never_sent, within
from dextera_build.calls.consent import refuse
from dextera_build.calls.limits import Limits
from dextera_build.calls.question import Question
from dextera_build.calls.services import Service, usd
from dextera_build.calls.spending import Bill
from dextera_build.calls.terms import Terms

Emit = Callable[[str, Mapping[str, object]], None]
T = TypeVar("T")


class Gate:
    """Passes the requests of one call on to its service.

    Args:
        asked: The call's question.
        terms: The command's terms.
        folder: Where the states of services are.
        emit: Takes `log` lines, and `paid` with the cost of a request.

    Raises:
        MachineError: The request holds data that may not be sent without consent.
    """

    def __init__(self, asked: Question, terms: Terms, folder: Path, emit: Emit) -> None:
        refuse(asked, terms.consents)
        self._asked, self._terms, self._emit = asked, terms, emit
        service = terms.services.get(asked.service, Service())
        self.price = service.price_of(asked.model)
        self.paid: float | None = None
        """Cost of the requests so far [USD]; None while none has a price."""
        self._limits = Limits(folder, asked.service, service.requests_per_minute, service.concurrent, self._log)

    @property
    def cost(self) -> float | None:
        """Cost of the answer [USD]: the amount paid here, else its price, if an earlier build submitted the job."""
        return self.paid if self.paid is not None else self.price.of({})

    def slot(self) -> AbstractContextManager[None]:
        """One of the service's `concurrent` slots, for a `with` block."""
        return self._limits.slot()

    def charged(self, send: Callable[[float], T], cost: Callable[[T], float | None]) -> Callable[[float], T]:
        """`send` within the limits of the service and of the costs; `cost` returns the cost of an answer [USD]."""

        def gated(timeout_s: float) -> T:
            self._limits.wait_for_turn()
            with self._bill() as bill:
                answer = self._sent(send, timeout_s, bill)
                found = None if _is_refusal(answer) else cost(answer)
                bill.amount = found or 0.0
            self._note(found)
            self._rest(answer)
            return answer

        return gated

    def free(self, send: Callable[[float], T]) -> Callable[[float], T]:
        """`send` within the limits of the service; the request costs nothing."""

        def gated(timeout_s: float) -> T:
            self._limits.wait_for_turn()
            answer = within(timeout_s, send)
            self._rest(answer)
            return answer

        return gated

    def call(self, send: Send) -> Send:
        """The sender of a call."""

        def cost(answer: bytes | Response) -> float | None:
            return self.price.of(amounts(answer.body if isinstance(answer, Response) else answer))

        charged = self.charged(send, cost)

        def gated(timeout_s: float) -> bytes | Response:
            with self.slot():
                return charged(timeout_s)

        return gated

    def mending(self, manner: Manner) -> Manner:
        """The manner of a call, whose repairs pass the gate, too."""
        repair = manner.repair
        return replace(manner, repair=lambda body, why: self.call(repair(body, why))) if repair else manner

    def job(self, job: Job) -> Job:
        """The client of a job; only its submission has a cost."""
        return _GatedJob(job, self)

    @contextmanager
    def _bill(self) -> Iterator[Bill]:
        if self._terms.spending is None:
            yield Bill(self.price.bound or 0.0)
            return
        with self._terms.spending.reserved(self._asked, self.price.bound) as bill:
            yield bill

    def _sent(self, send: Callable[[float], T], timeout_s: float, bill: Bill) -> T:
        try:
            return within(timeout_s, send)
        except Exception as error:
            if was_never_sent(error):
                bill.amount = 0.0
            elif bill.amount:
                self._note(bill.amount, sure=False)
            raise

    def _note(self, amount: float | None, *, sure: bool = True) -> None:
        if amount is None:
            return
        self.paid = (self.paid or 0.0) + amount
        named = {"service": self._asked.service, "model": self._asked.model}
        self._emit("paid", {**named, "usd": amount, "sure": sure})
        if sure and self.price.bound is not None and amount > self.price.bound + 1e-9:
            self._log(f"{self._asked.shown} cost {usd(amount)}, more than its price of {usd(self.price.bound)}")

    def _rest(self, answer: object) -> None:
        """Keep all processes from a service that requires a pause."""
        if isinstance(answer, Response) and answer.status in (429, 503):
            after_s = retry_after(answer.headers)
            if after_s is not None and after_s <= MOST_RETRY_AFTER_S:
                self._limits.rest(after_s)

    def _log(self, text: str) -> None:
        self._emit("log", {"text": text})


class _GatedJob:
    """A job whose requests pass the gate."""

    def __init__(self, job: Job, gate: Gate) -> None:
        self._job, self._gate = job, gate

    def submit(self, timeout_s: float) -> str | Response:
        return self._gate.charged(self._job.submit, lambda name: self._gate.price.of({}))(timeout_s)

    def poll(self, name: str, timeout_s: float) -> JobState | Response:
        return self._gate.free(lambda seconds: self._job.poll(name, seconds))(timeout_s)

    def fetch(self, name: str, timeout_s: float) -> bytes | Response:
        return self._gate.free(lambda seconds: self._job.fetch(name, seconds))(timeout_s)

    def cancel(self, name: str, timeout_s: float) -> bool:
        return self._job.cancel(name, timeout_s)


def _is_refusal(answer: object) -> bool:
    return isinstance(answer, Response) and not 200 <= answer.status < 300
