"""A link to a policy in another process: requests and answers with limits of time and size, and one error per fault."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn, Protocol

from dextera_build.errors import MachineError
from dextera_build.policy.running import PolicyFault

LARGEST = 64 * 2**20
"""Largest message [bytes]; a request with ten pictures of a megapixel has 30 MB."""
CONNECT_S = 10.0
"""Time limit of a connection [s]."""


class Link(Protocol):
    """A policy at an address."""

    greeting: bytes
    """First message of its server; empty if the protocol has none."""

    def ask(self, request: Mapping[str, Any], limit_s: float) -> Mapping[str, Any]:
        """The answer to a request, with the joint targets in `actions`.

        Args:
            request: Key -> array, text or plain data.
            limit_s: Time limit of the answer [s].

        Raises:
            PolicyFault: There is no answer, or it is no answer of the protocol. The link is of no more use.
        """
        ...

    def close(self) -> None:
        """End the connection."""
        ...


def unreachable(address: str, reason: object, hint: str = "") -> MachineError:
    """The error for an address where no policy can be asked."""
    return MachineError(
        f"no policy can be asked at `{address}`",
        code="DXB-E328",
        facts={"reason": reason},
        hint=hint or "start its server, `dxb serve RECIPE:NODE`, or set `address` to where it runs",
    )


def late(address: str, limit_s: float) -> PolicyFault:
    """The fault of a policy that does not answer in time."""
    return PolicyFault(
        f"the policy at `{address}` gave no answer in {limit_s:g} s",
        code="DXB-B540",
        hint="set `answer_s`, or `first_s` for the first answer, which may compile the network",
    )


def lost(address: str, reason: object) -> PolicyFault:
    """The fault of a connection that ended before the answer."""
    return PolicyFault(
        f"the connection to the policy at `{address}` was lost",
        code="DXB-B541",
        facts={"reason": reason},
        hint="the server's log says why it ended; start it again",
    )


def failed(address: str, text: str, hint: str = "the server's log says more") -> PolicyFault:
    """The fault of a server that answers with an error: the traceback of a program, or a message."""
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["an empty error"]
    last = lines[-1] if lines[0].startswith("Traceback") else lines[0]
    return PolicyFault(
        f"the policy at `{address}` answered with an error: {last[:200]}",
        code="DXB-B542",
        facts={"it says": text.strip()[-2000:]} if len(lines) > 1 else None,
        hint=hint,
    )


def unusable(address: str, what: str, hint: str | None = None, **facts: object) -> PolicyFault:
    """The fault of an answer that holds no joint targets for this robot."""
    return PolicyFault(f"the answer of the policy at `{address}` {what}", code="DXB-B543", facts=facts, hint=hint)


def too_large(address: str, whose: str) -> NoReturn:
    """Raise for a message above the limit of size.

    Raises:
        PolicyFault: Always.
    """
    raise PolicyFault(
        f"{whose} the policy at `{address}` is too large",
        code="DXB-B544",
        facts={"limit here": f"{LARGEST // 2**20} MiB"},
        hint="send smaller pictures: a view with another `width_px` and `height_px`",
    )
