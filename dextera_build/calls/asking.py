"""Sends a request to a service: timeouts, retries with backoff, and errors for unusable answers."""

from __future__ import annotations

import json
import os
import re
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from email.utils import parsedate_to_datetime
from functools import partial
from http.client import HTTPException
from typing import NoReturn, TypeAlias, TypeVar

from dextera_build.calls import JobManner, Response
from dextera_build.calls.question import Question
from dextera_build.calls.secrets import secret_in, without_secrets
from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.store.backoff import backoff

Send: TypeAlias = Callable[[float], bytes | Response]
"""Timeout [s] -> the answer."""
T = TypeVar("T")
MOST_RETRY_AFTER_S = 300.0
"""A service that requires a longer pause is given up [s]."""
_NEVER_SENT = {"httpx.ConnectError", "httpx.ConnectTimeout", "httpx.PoolTimeout", "httpx.UnsupportedProtocol"}
_PATIENCE = 10.0
"""A request whose answer is still coming in after so many timeouts is given up."""
_SHOWN = 200
_TOLD = 4000
"""Most of an error's text that goes back to a model [characters]."""
_USAGE = {"prompt_tokens": "tokens", "completion_tokens": "tokens", "total_tokens": "tokens", "cost": "USD"}
_ALSO = {"input_tokens": "prompt_tokens", "output_tokens": "completion_tokens"}


@dataclass(frozen=True)
class Manner:
    """Timeouts, retries and checks of a call; `poll_s` and `limit_s` apply to jobs. See `JobManner`."""

    timeout_s: float = 60.0
    tries: int = 4
    wait_s: float = 1.0
    """Wait before the second try [s], doubled before each further one."""
    valid: Callable[[bytes], object] | None = None
    """Raises `ValueError` or `RuleError` for an unusable body, which is not recorded."""
    secrets: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    repair: Callable[[bytes, str], Send] | None = None
    repairs: int = 2
    poll_s: float = 5.0
    limit_s: float = 3600.0

    @classmethod
    def of(cls, given: JobManner) -> Manner:
        """The manner with the given keywords, and one try at least."""
        found = cls(**given)
        return replace(found, tries=max(found.tries, 1), secrets=tuple(found.secrets), data=tuple(found.data))


class _AgainError(Exception):
    """The call is worth a retry, after `after_s` [s] if the service states a time."""

    def __init__(self, why: str, after_s: float | None = None, *, invalid: bool = False) -> None:
        super().__init__((why.splitlines() or [""])[0][:_SHOWN])
        self.whole = why[:_TOLD]
        self.after_s, self.invalid = after_s, invalid


def ask(asked: Question, send: Send, manner: Manner, log: Callable[[str], None]) -> tuple[Response, float]:
    """Send the request; return the answer, and the duration of the try that succeeded [s].

    Raises:
        MachineError: The service cannot be reached, is overloaded, or denies access.
        RuleError: It refuses the request, or its answer is unusable.
    """
    mending = _Mending(send, manner, log)

    def once() -> Response:
        while True:
            answer = _sent(asked, mending.send, manner)
            response = answer if isinstance(answer, Response) else Response(answer)
            try:
                checked(asked, response, manner)
            except _AgainError as fault:
                mending.go_on(asked, response.body, fault)
            else:
                return response

    return tried(once, asked, manner, log)


class _Mending:
    """The sender of a call, and after an unusable answer the sender that adds the reason."""

    def __init__(self, send: Send, manner: Manner, log: Callable[[str], None]) -> None:
        self.send, self._manner, self._log = send, manner, log
        self._done = 0

    def go_on(self, asked: Question, body: bytes, fault: _AgainError) -> None:
        """Prepare the next repair; raises the fault where there is none to make."""
        if self._manner.repair is None or not fault.invalid:
            raise fault
        if self._done >= self._manner.repairs:
            _give_up(asked, fault, self._done + 1)
        self._done += 1
        self._log(f"{asked.shown}: {fault}; told so, repair {self._done} of {self._manner.repairs}")
        self.send = self._manner.repair(body, fault.whole)


def step(asked: Question, send: Callable[[float], T | Response], manner: Manner, log: Callable[[str], None]) -> T:
    """Send one request of a job; return its answer.

    Raises:
        DxbError: As for `ask`.
    """

    def once() -> T:
        answer = _sent(asked, send, manner)
        if isinstance(answer, Response):
            _look_at_status(asked, answer, manner)
            raise TypeError(f"a job of `{asked.service}` returned a response in place of its value")
        return answer

    return tried(once, asked, manner, log)[0]


def tried(once: Callable[[], T], asked: Question, manner: Manner, log: Callable[[str], None]) -> tuple[T, float]:
    """Call `once` until it does not ask for another try; return its value and the duration of that try [s]."""
    for number in range(1, manner.tries + 1):
        began = time.monotonic()
        try:
            found = once()
        except _AgainError as fault:
            if number == manner.tries or (fault.after_s or 0.0) > MOST_RETRY_AFTER_S:
                _give_up(asked, fault, number)
            rest = backoff(number, manner.wait_s, asked.key) if fault.after_s is None else fault.after_s
            log(f"{asked.shown}: {fault}; asked again in {rest:.1f} s, try {number + 1} of {manner.tries}")
            time.sleep(rest)
        else:
            return found, time.monotonic() - began
    raise AssertionError("the last try returns or raises")


def checked(asked: Question, answer: bytes | Response, manner: Manner) -> bytes:
    """The body of an answer with a good status that holds no secret and passes `Manner.valid`.

    Raises:
        DxbError: The service refuses the request, or the answer holds a secret.
    """
    if isinstance(answer, Response):
        _look_at_status(asked, answer, manner)
    body = answer.body if isinstance(answer, Response) else answer
    _look_at_body(asked, body, manner)
    return body


def amounts(body: bytes) -> dict[str, tuple[float, str]]:
    """Tokens and cost from the field `usage` of a JSON answer."""
    try:
        usage = json.loads(body)["usage"]
        rows = {_ALSO.get(name, name): usage[name] for name in (*_ALSO, *_USAGE) if name in usage}
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    right = {name: value for name, value in rows.items() if isinstance(value, int | float) and 0 <= value < 1e15}
    return {name: (float(value), _USAGE[name]) for name, value in right.items()}


def _sent(asked: Question, send: Callable[[float], T], manner: Manner) -> T:
    try:
        return send(manner.timeout_s)
    except (DxbError, _AgainError):
        raise
    except Exception as error:
        why = without_secrets(f"{type(error).__name__}: {error}".rstrip(": "), manner.secrets)
        if _is_transport(error):
            raise _AgainError(why) from None
        # Replaced, since its traceback in the node's log could contain an address with a key.
        raise RuleError(
            f"the call of `{asked.shown}` failed: {why.splitlines()[0][:_SHOWN]}",
            code="DXB-B344",
            facts=asked.facts(),
            hint=_unset(error),
        ) from None


def _unset(error: Exception) -> str | None:
    """The next step if `os.environ[NAME]` failed, as in a request that takes its address from a variable."""
    name = str(error.args[0]) if isinstance(error, KeyError) and error.args else ""
    if not re.fullmatch(r"[A-Z][A-Z0-9_]+", name) or name in os.environ:
        return None
    return f"set the environment variable `{name}`, or build with `--calls replay`"


def within(timeout_s: float, send: Callable[[float], T]) -> T:
    """The answer of `send`, given its timeout [s]; timeouts of sockets start again with every byte.

    Raises:
        TimeoutError: The answer is not complete after ten timeouts.
    """
    ends: list[Callable[[], T]] = []

    def run() -> None:
        try:
            value = send(timeout_s)
            ends.append(lambda: value)
        except BaseException as error:
            ends.append(partial(_raise, error))

    thread = threading.Thread(target=run, name="request", daemon=True)
    thread.start()
    thread.join(_PATIENCE * timeout_s)
    if not ends:
        raise TimeoutError(f"the answer is not complete after {_PATIENCE * timeout_s:.0f} s")
    return ends[0]()


def _raise(error: BaseException) -> NoReturn:
    raise error


def was_never_sent(error: Exception) -> bool:
    """Whether an error of `send` means that the service did not receive the request."""
    reason = getattr(error, "reason", error)  # of `urllib.error.URLError`
    refused = isinstance(reason, ConnectionRefusedError | socket.gaierror | DxbError)
    return refused or not _NEVER_SENT.isdisjoint(_names(error))


def _is_transport(error: Exception) -> bool:
    return isinstance(error, OSError | HTTPException) or "httpx.TransportError" in _names(error)


def _names(error: Exception) -> set[str]:
    # httpx by name: importing it takes longer than most calls of a rule.
    return {f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in type(error).__mro__}


def _look_at_status(asked: Question, response: Response, manner: Manner) -> None:
    status = response.status
    if 200 <= status < 300:
        return
    if status in (408, 425, 429) or status >= 500:
        raise _AgainError(f"it answered {status}", retry_after(response.headers))
    if status in (401, 403):
        raise MachineError(
            f"`{asked.shown}` denies access: it answered {status}",
            code="DXB-E361",
            facts=asked.facts(),
            hint="set the key that the backend takes from the environment, or build with `--calls replay`",
        )
    said = without_secrets(response.body[:_SHOWN].decode(errors="replace"), manner.secrets)
    raise RuleError(
        f"`{asked.shown}` refuses the request: it answered {status}",
        code="DXB-B344",
        facts=asked.facts() | {"it said": " ".join(said.split()) or "nothing"},
    )


def _look_at_body(asked: Question, body: bytes, manner: Manner) -> None:
    if found := secret_in(body, manner.secrets):
        raise RuleError(
            f"the answer of `{asked.shown}` holds {found}, so it is not recorded",
            code="DXB-B346",
            facts=asked.facts(),
            hint="the service echoes its request; send the secret in a header",
        )
    if manner.valid is None:
        return
    try:
        manner.valid(body)
    except (ValueError, KeyError, TypeError, IndexError, RuleError) as error:
        why = without_secrets(str(error) or type(error).__name__, manner.secrets)
        raise _AgainError(why, invalid=True) from None


def _give_up(asked: Question, fault: _AgainError, tries: int) -> NoReturn:
    facts = asked.facts() | {"tries": tries}
    if fault.invalid:
        raise RuleError(
            f"`{asked.shown}` gives no usable answer: {fault}",
            code="DXB-B345",
            facts=facts,
            hint="nothing was recorded; the next build asks again",
        ) from None
    if fault.after_s is not None:
        facts["asks to wait"] = f"{fault.after_s:.0f} s"
    raise MachineError(
        f"`{asked.shown}` cannot be reached: {fault}",
        code="DXB-E360",
        facts=facts,
        hint="build again later; answers so far are recorded",
    ) from None


def retry_after(headers: Mapping[str, str]) -> float | None:
    """The pause of `Retry-After` [s], in either of its forms (RFC 9110, 10.2.3); None without it."""
    text = next((value for name, value in headers.items() if name.lower() == "retry-after"), "").strip()
    if text.isdecimal():
        return float(text)
    try:
        return max(0.0, parsedate_to_datetime(text).timestamp() - time.time())
    except (ValueError, TypeError):
        return None
