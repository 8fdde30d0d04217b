"""The functions of a backend or a companion, compared with a `Protocol` when they are called."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable
from functools import wraps
from typing import Any

from dextera_build.artifacts.base import Artifact
from dextera_build.errors import RuleError, did_you_mean, listing


class Chosen:
    """A module as `ctx.backend` or `ctx.companion`; names that are not in the `Protocol` are private to the module.

    Args:
        module: The module.
        protocol: Interface of the module; None for a rule without one.
        shown: ``backend `umbrella` of factorize.smooth``, for messages.
    """

    def __init__(self, module: Any, protocol: type[Any] | None, shown: str) -> None:
        self._module, self._protocol, self._shown = module, protocol, shown

    def __getattr__(self, name: str) -> Any:
        declared = vars(self._protocol).get(name) if self._protocol and not name.startswith("_") else None
        if not inspect.isfunction(declared):
            return getattr(self._module, name)
        function = getattr(self._module, name, None)
        if not callable(function):
            raise self._lacks(name, declared)
        return self._checked(function, declared)

    def _lacks(self, name: str, declared: Callable[..., Any]) -> RuleError:
        own = [each for each, value in vars(self._module).items() if inspect.isfunction(value) and each[0] != "_"]
        parameters = ", ".join(list(inspect.signature(declared).parameters)[1:])
        return RuleError(
            f"{self._shown} has no function `{name}`",
            code="DXB-B308",
            facts={"file": self._module.__file__, "its functions": listing(own) or "none"},
            hint=did_you_mean(name, own) or f"the `Protocol` asks for `def {name}({parameters})`",
        )

    def _checked(self, function: Callable[..., Any], declared: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*inputs: Any, **named: Any) -> Any:
            answer = function(*inputs, **named)
            wanted = _returned(declared)
            # By name, which also distinguishes stored values.
            if wanted and wanted not in {kind.__name__ for kind in type(answer).__mro__}:
                raise RuleError(
                    f"`{function.__name__}` of {self._shown} returned {_kind(answer)}, not {wanted}",
                    code="DXB-B309",
                    facts={"file": self._module.__file__},
                    hint=f"the `Protocol` says `-> {wanted}`",
                )
            return answer

        return call


def _returned(declared: Callable[..., Any]) -> str:
    """The name of the artifact that a function of a `Protocol` returns; empty for any other type."""
    try:
        kind = typing.get_type_hints(declared)["return"]
    except (NameError, KeyError):  # imported for a type checker only, or not annotated
        return ""
    return kind.__name__ if isinstance(kind, type) and issubclass(kind, Artifact) else ""


def _kind(answer: object) -> str:
    return "nothing (None)" if answer is None else f"`{type(answer).__name__}`"
