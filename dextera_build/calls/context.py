"""Services for a running rule; the base of `rule.Context`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from typing_extensions import Unpack

from dextera_build.calls import CallManner, Job, JobManner, Response, secrets
from dextera_build.errors import RuleError


class Calling:
    """Calls of services for a running rule.

    Args:
        calls: Executes `call` and `job`; None if no recorder exists.
        emit: Takes (kind, data) messages as they occur; `secret` with the name of a secret that the rule requested.
    """

    def __init__(
        self, calls: Callable[..., bytes] | None, emit: Callable[[str, Mapping[str, object]], None] | None = None
    ) -> None:
        self._calls = calls
        self._emit = emit or (lambda kind, data: None)

    def call(
        self,
        service: str,
        request: Mapping[str, Any],
        send: Callable[[float], bytes | Response],
        **manner: Unpack[CallManner],
    ) -> bytes:
        """The answer of an external service: a model in a cloud, a generator behind an API.

        The answer is recorded under the digest of `service` and `request`. If a recorded answer exists, nothing is
        sent, so a build can be repeated without network access or cost.

        Args:
            service: Name of the service, never its address.
            request: Everything that the answer depends on, as plain data; bytes enter by digest. No key, host or time.
            send: Called with a timeout [s] if no answer is recorded; adds host and key, and returns the body or a
                `Response` with the status. `OSError`, httpx's transport errors, and the statuses 429 and 5xx are
                retried.
            manner: See `CallManner`.

        Raises:
            DxbError: No answer is recorded and requests are not allowed, or the service gives no answer.
        """
        return self._ask(service, request, send, manner)

    def job(self, service: str, request: Mapping[str, Any], job: Job, **manner: Unpack[JobManner]) -> bytes:
        """The answer of a service that takes minutes: a job is submitted, polled until it is done, and fetched.

        The answer is recorded like that of `call`. The name of a running job is saved with the progress of unfinished
        calls (see `Context.keep`), so that a build after a kill waits for the same job instead of paying for a second
        one, even if the rule was edited in between. Ctrl-C cancels the job.

        Args:
            service: See `call`.
            request: See `call`.
            job: The service's client.
            manner: See `JobManner`.

        Raises:
            DxbError: As for `call`; the job failed, or takes longer than `limit_s`.
        """
        return self._ask(service, request, job, manner)

    def secret(self, name: str) -> str:
        """An API key or password: the variable `name`, or else the entry `name` of the service `dxb` in the keyring.

        It is removed from what the node prints, raises and reports of its result, also where it is quoted or encoded in
        base64. Requests, answers and results that hold it are refused. It must not be passed on in any other way, as
        in a file of `ctx.keep`, which is not searched.

        Raises:
            MachineError: There is no such secret.
        """
        self._emit("secret", {"name": name})
        return secrets.get(name)

    def _ask(self, service: str, request: Mapping[str, Any], how: object, manner: Mapping[str, Any]) -> bytes:
        if self._calls is None:
            raise RuleError("nothing records calls here", code="DXB-B348", facts={"service": service})
        return self._calls(service, request, how, **manner)
