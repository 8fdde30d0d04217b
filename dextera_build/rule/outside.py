"""Implements `ctx.outside`: writes a request, runs the backend's program on it, and reads the response."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.formats import exchange
from dextera_build.outside import messages, servers
from dextera_build.outside.program import Program
from dextera_build.outside.running import Emit, Running
from dextera_build.rule.options import Options
from dextera_build.rule.pretrained import Device


@dataclass(frozen=True)
class Outside:
    """The program of a call's backend.

    Args:
        program: Declaration of the backend.
        rule: `factorize.mesh`.
        backend: `trellis`.
        key: Digest of each of its files, as in the key of the call.
        protocol: Interface of the rule's backends.
        environment: Variables for the program.
    """

    program: Program
    rule: str
    backend: str
    key: Mapping[str, str]
    protocol: type[Any] | None = None
    environment: Mapping[str, str] = field(default_factory=dict)

    def ask(
        self,
        function: str,
        returns: Any,
        inputs: Mapping[str, Any],
        *,
        options: Options,
        weights: Mapping[str, Path],
        device: Device,
        scratch: Callable[[], Path],
        emit: Emit,
    ) -> tuple[Any, str, dict[str, tuple[float, str]]]:
        """The output of a function of the program, its line and its metrics.

        Raises:
            RuleError: The program refused, failed, exceeded a limit, or answered in another form.
            MachineError: Something that it needs is missing here.
        """
        returns = _narrowed(self._declared(function), inputs.values()) if returns is None else returns
        self.program.check(self.key)
        running = self._running(tuple(weights.values()), device)
        try:
            plain = options.model_dump(mode="json")
            folder = exchanged(
                running,
                inputs,
                emit,
                rule=self.rule,
                backend=self.backend,
                function=function,
                options=plain,
                weights={name: str(path) for name, path in weights.items()},
                device=device,
                seed=plain["seed"] if isinstance(plain.get("seed"), int) else 0,
            )
            self.program.check(self.key)
            # The result may refer to files of the response until it is stored.
            kept = Path(shutil.move(folder / messages.RESPONSE, _free(scratch())))
            shutil.rmtree(folder, ignore_errors=True)
            answer = answered(kept, returns, f"backend `{self.backend}` of {self.rule}")
        except BaseException as error:
            # A server that refuses is well; one that failed, or answers something else, may be out of step.
            if not (running.server and isinstance(error, RuleError) and error.code == "DXB-B378"):
                running.end()
            raise
        if not running.server:
            running.end()
        return answer

    def _declared(self, function: str) -> Any:
        """Return type of a function in the rule's `Protocol`."""
        found = getattr(self.protocol, function, None)
        if found is None:
            raise RuleError(
                f"`{function}` is no function of the backends of {self.rule}",
                code="DXB-B382",
                hint=f'name the type of the answer: `ctx.outside("{function}", Mesh, ...)`',
            )
        # Rules import NumPy for a type checker only.
        return get_type_hints(found, localns={"np": np}, include_extras=True)["return"]

    def _running(self, folders: tuple[Path, ...], device: Device) -> Running:
        def start() -> Running:
            return self.program.run(self.environment, folders, gpu=device == "cuda")

        if not self.program.server:
            return start()
        key = (self.rule, self.backend, tuple(sorted(self.key.items())), folders, device, self.program)
        return servers.kept(key, start)


def exchanged(running: Running, inputs: Mapping[str, Any], emit: Emit, **request: Any) -> Path:
    """Ask a running program; the folder of the request, in which it has put its response.

    Args:
        running: The program.
        inputs: Inputs of the function.
        emit: Takes what the program tells while it works.
        request: Other fields of `messages.Request`.

    Raises:
        RuleError: It failed or exceeded a limit.
    """
    folder = running.exchange()
    at = folder / messages.REQUEST
    written = {name: exchange.write(value, at, name) for name, value in inputs.items()}
    messages.write(messages.Request(protocol=messages.PROTOCOL, inputs=written, **request), at)
    running.ask(folder, emit)
    return folder


def answered(response: Path, returns: Any, name: str) -> tuple[Any, str, dict[str, tuple[float, str]]]:
    """The output in the folder of a response, its line and its metrics.

    Args:
        response: The folder.
        returns: Type of the output.
        name: What the program is called in messages.

    Raises:
        RuleError: The program refused, or answered in another form.
    """
    found = messages.read(response)
    if isinstance(found, messages.Refused):
        raise RuleError(found.message, code="DXB-B378", hint=found.hint or None, facts={"said by": name})
    try:
        return exchange.read(found.output, returns, response), found.line, dict(found.metrics)
    except ArtifactError as error:
        raise RuleError(
            f"the answer of {name} cannot be used: {error.message}",
            code="DXB-B376",
            facts=error.facts,
            hint=error.hint or "docs/outside.md describes the form of every value",
        ) from None


def _free(scratch: Path) -> Path:
    """A path in the scratch folder that does not exist."""
    return next(path for count in range(1 << 20) if not (path := scratch / f"response-{count}").exists())


def _narrowed(returns: Any, inputs: Collection[Any]) -> Any:
    """The declared type, in which a base class is the class of the only input derived from it.

    `fitted(own: Options) -> tuple[TaskOptions, Options]` returns the options of the primitive that it was given.
    """
    if parts := get_args(returns):
        narrowed = tuple(_narrowed(part, inputs) for part in parts)
        return tuple.__class_getitem__(narrowed) if get_origin(returns) is tuple else returns
    if not isinstance(returns, type) or issubclass(returns, Artifact):
        return returns
    derived = {type(value) for value in inputs if isinstance(value, returns)}
    return derived.pop() if len(derived) == 1 else returns
