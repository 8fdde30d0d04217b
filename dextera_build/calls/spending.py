"""Cost of the calls of one command, over all its worker processes, and its limit."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dextera_build.calls.limits import locked_json
from dextera_build.calls.question import Question
from dextera_build.calls.services import usd
from dextera_build.errors import RuleError

LEDGER = "DXB_LEDGER"
"""Variable with the ledger of the command that a process belongs to."""
_LOOK_S = 0.1


class Spending:
    """A ledger in a file: the amount spent, and the maximum cost of requests under way.

    Args:
        ledger: The file.
        most: The most that the command may spend [USD].
    """

    def __init__(self, ledger: Path, most: float) -> None:
        self._ledger, self._most = ledger, most

    @contextmanager
    def reserved(self, asked: Question, bound: float | None) -> Iterator[Bill]:
        """Reserve the maximum cost of a request; afterwards, record the amount of the bill.

        If the block raises before the bill is paid, the request may have been charged, and the whole amount was spent.

        Raises:
            RuleError: The request has no price, or could exceed the limit; it must not be sent.
        """
        if bound is None:
            raise RuleError(
                f"no price bounds a call of `{asked.shown}`, and the build may spend {usd(self._most)}",
                code="DXB-B362",
                facts=asked.facts(),
                hint=f"in `dxb.toml`: [services.{asked.service}] usd_per_call = ..., or most_usd_per_call = ... where "
                "tokens are counted; 0 if it is free",
            )
        name = self._reserve(asked, bound)
        bill = Bill(bound)
        try:
            yield bill
        finally:
            with locked_json(self._ledger) as state:
                state.get("reserved", {}).pop(name, None)
                state["spent"] = _spent(state) + bill.amount

    def total(self) -> float:
        """The amount spent, and the maximum cost of requests under way [USD]."""
        with locked_json(self._ledger) as state:
            return _spent(state) + _under_way(state)

    def _reserve(self, asked: Question, bound: float) -> str:
        name = os.urandom(8).hex()
        while True:
            with locked_json(self._ledger) as state:
                _settle_dead(state)
                spent, under_way = _spent(state), _under_way(state)
                if spent + under_way + bound <= self._most + 1e-9:
                    state.setdefault("reserved", {})[name] = [os.getpid(), bound]
                    return name
            if spent + bound > self._most + 1e-9:
                raise RuleError(
                    f"a call of `{asked.shown}` could exceed the limit of {usd(self._most)}, so it was not sent",
                    code="DXB-B361",
                    facts=asked.facts() | {"spent": usd(spent), "the call costs up to": usd(bound)},
                    hint=f"`--max-cost {spent + bound:.2f}` or more; answers so far are recorded",
                )
            time.sleep(_LOOK_S)  # a request under way may turn out cheaper


class Bill:
    """Cost of one request [USD]; `bound` until the bill is paid."""

    def __init__(self, bound: float) -> None:
        self.amount = bound


def open_ledger() -> tuple[int, str]:
    """The descriptor and the path of an empty ledger without a file: it vanishes with this process."""
    descriptor = os.memfd_create("spent")
    return descriptor, f"/proc/{os.getpid()}/fd/{descriptor}"


def _spent(state: dict[str, Any]) -> float:
    return float(state.get("spent", 0.0))


def _under_way(state: dict[str, Any]) -> float:
    return sum(float(bound) for _, bound in state.get("reserved", {}).values())


def _settle_dead(state: dict[str, Any]) -> None:
    """Count the requests of processes that died as charged."""
    for name, (process, bound) in list(state.get("reserved", {}).items()):
        if not Path(f"/proc/{process}").exists():
            del state["reserved"][name]
            state["spent"] = _spent(state) + bound
