"""The context of a running rule: its backend, folders, the project's files, services, the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NoReturn, Protocol, TypeVar, cast, overload

import typing_extensions

from dextera_build.artifacts.base import File
from dextera_build.calls.context import Calling
from dextera_build.errors import RuleError, listing
from dextera_build.rule.options import Options
from dextera_build.rule.pretrained import Device, Pretrained

if TYPE_CHECKING:
    import numpy as np

M = TypeVar("M")
B = typing_extensions.TypeVar("B", default=Any)
"""The `Protocol` of a rule's backends."""


@dataclass
class Outcome:
    """Line, warnings, previews and metrics of a rule, in addition to its result."""

    line: str = ""
    warnings: list[str] = field(default_factory=list)
    previews: list[tuple[str, bytes]] = field(default_factory=list)
    metrics: dict[str, tuple[float, str]] = field(default_factory=dict)

    @property
    def told(self) -> str:
        """The line with the warnings: `12 objects; warning: ...`. One line, because results travel in bundles."""
        return "; ".join(filter(None, [self.line, *(f"warning: {text}" for text in self.warnings)]))


class Reads(Protocol):
    """Files of the project for one call; see `Context.read`."""

    def file(self, path: str) -> File:
        """The file at `path`."""
        ...

    def glob(self, pattern: str) -> list[str]:
        """Files of the project that match `pattern`."""
        ...

    def exists(self, path: str) -> bool:
        """Whether a file or folder exists at `path`."""
        ...


class _Other:
    """A backend whose functions take neither context nor options."""

    def __init__(self, ctx: Context[Any], module: Any, options: Options) -> None:
        self._ctx, self._module, self._options = ctx, module, options

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function = getattr(self._module, name)
        return lambda *inputs: function(self._ctx, *inputs, self._options)


class Context(Calling, Generic[B]):
    """Services for a running rule; `Context[MeshBackend]` for a rule whose backends follow that `Protocol`.

    Args:
        backend: The chosen backend's module, or None for a rule without backends.
        backend_options: The backend's own options, for the last argument of its functions.
        scratch: A private folder of this call, removed afterwards; or a function that creates it on first use.
        emit: Takes (kind, data) messages as they occur: `progress`, `log`.
        keep: See the property `keep`; None for a folder below `scratch`.
        calls: Executes `call` and `job`; None if no recorder exists.
        reads: Reads files of the project; None for a rule that does not declare `discovers`.
        pretrained: Weights, device and program of the backend; None for one without any.
        companions: Gives the module of a slot and a name, compared with a `Protocol`; None if no input has any.
        named: Option that names a folder -> that name, and the options of the folder as JSON.
    """

    def __init__(  # noqa: PLR0913 - one argument per service
        self,
        backend: Any = None,
        backend_options: Options | None = None,
        *,
        scratch: Path | Callable[[], Path],
        emit: Callable[[str, Mapping[str, object]], None] | None = None,
        keep: Path | Callable[[], Path] | None = None,
        calls: Callable[..., bytes] | None = None,
        reads: Reads | None = None,
        pretrained: Pretrained | None = None,
        companions: Callable[[str, str, type[Any]], Any] | None = None,
        named: Mapping[str, tuple[str, bytes]] | None = None,
    ) -> None:
        super().__init__(calls, emit)
        self.backend = cast(B, backend)
        self.backend_options = backend_options or Options()
        self._scratch = scratch
        self.outcome = Outcome()
        self._keep = keep
        self._reads = reads
        self._pretrained = pretrained or Pretrained()
        self._companions = companions
        self._named = named or {}

    @cached_property
    def scratch(self) -> Path:
        """A private folder of this call, removed afterwards."""
        return self._scratch if isinstance(self._scratch, Path) else self._scratch()

    @property
    def keep(self) -> Path:
        """A folder for saved progress that survives a kill, a failure and Ctrl-C, so that the next build can resume.

        Empty at first; removed once the call's result is in the store, and never part of it: a resumed call must return
        the same bytes as an uninterrupted one. The call may be killed at any moment, so write a temporary file and
        rename it.
        """
        kept = self._keep() if callable(self._keep) else self._keep
        folder = kept or self.scratch / "keep"
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def weights(self, name: str) -> Path:
        """The folder with the weights of a model that the backend declares in `BACKEND.weights`.

        The files are those whose digest is in the key, and read-only.

        Raises:
            RuleError: The backend does not declare the model.
            MachineError: This machine does not have them; on a cluster, another may.
        """
        return self._pretrained.folder(name)

    @property
    def device(self) -> Device:
        """Where a model runs, as torch spells it: `cuda` is the GPU granted to this call, the only visible one."""
        return self._pretrained.device

    def load(self, load: Callable[..., M], *names: str) -> M:
        """A model, loaded at most once per worker and kept for the next nodes that ask for the same.

        Args:
            load: A function of a module, called with the folder of each of `names` and the device.
            names: Models that the backend declares in `BACKEND.weights`.

        Raises:
            RuleError: The backend does not declare a model.
            MachineError: This machine does not have the weights, or its memory does not hold the model.
        """
        return self._pretrained.load(load, names)

    def other(self, name: str) -> Any:
        """Another backend of the rule, which this one declares in `BACKEND.uses`.

        Its functions are called without `ctx` and options: `ctx.other("stub").complete(seen, common)`. It is given this
        context and the defaults of its own options.

        Raises:
            RuleError: The backend does not declare it.
        """
        others = self._pretrained.others
        if others is None:
            raise RuleError("a call without a backend uses one", code="DXB-B381", hint="declare `Context[...]`")
        return _Other(self, *others(name))

    def companion(self, slot: str, name: str, protocol: type[Any]) -> Any:
        """The module that runs the artifact in a slot, of `@rule(runs={slot: ...})`: next to the rule that made it.

        Args:
            slot: An input.
            name: Folder of the rule that made the artifact, from the artifact: `act` of `rules/learn/act/`; with
                `@rule(runs={slot: ""})` the name of the rule itself.
            protocol: The `Protocol` that the module follows.

        Raises:
            RuleError: No rule that made the artifact is in such a folder.
        """
        if self._companions is None:
            raise RuleError(
                f"no code was given that runs `{name}` of the input `{slot}`",
                code="DXB-B385",
                hint="run the rule in a build, or by `RuleRunner`",
            )
        return self._companions(slot, name, protocol)

    def named(self, option: str, protocol: type[Any]) -> tuple[Any, Any]:
        """The module in the folder that an option names, as `@rule(folders=...)` declares, and its `Options` as set.

        Args:
            option: The option.
            protocol: The `Protocol` that the module follows.
        """
        name, given = self._named[option]
        module = self.companion(option, name, protocol)
        return module, module.Options.model_validate_json(given)

    @overload
    def outside(self, function: str, returns: type[M], /, **inputs: object) -> M: ...
    @overload
    def outside(self, function: str, returns: Any = None, /, **inputs: object) -> Any: ...
    def outside(self, function: str, returns: Any = None, /, **inputs: object) -> Any:
        """The answer of the backend's program, which runs in a process and an environment of its own.

        The program is given the inputs as files, the backend's options, its weights and the device; it is killed with
        everything that it started when the call ends. Its line and metrics become those of the result.

        Args:
            function: Name of a function of the program.
            returns: Type of the answer: an artifact, a named tuple or dataclass of artifacts and arrays, a dict, ...;
                left out, that of the function of this name in the rule's `Protocol`.
            inputs: Name -> value: artifacts, arrays, `Options`, plain data.

        Raises:
            RuleError: The backend declares no program, or it refused, failed, or exceeded a limit.
            MachineError: This machine lacks a requirement of the program.
        """
        program = self._pretrained.program
        if program is None:
            raise RuleError(
                "the backend declares no program",
                code="DXB-B380",
                facts={"function": function, "inputs": listing(inputs)},
                hint='`BACKEND = Backend(..., command=("{python}", "program.py"))`',
            )
        answer, line, metrics = program.ask(
            function,
            returns,
            inputs,
            options=self.backend_options,
            weights=self._pretrained.folders(),
            device=self.device,
            scratch=lambda: self.scratch,
            emit=self._emit,
        )
        self.outcome.line = line or self.outcome.line
        self.outcome.metrics |= metrics
        return answer

    def read(self, path: str) -> bytes:
        """The content of a project file; `path` is relative to the project folder.

        Files read this way need not be inputs: they are recorded in order, and the result stays valid until one of them
        changes. The rule must declare `discovers=True`.

        Raises:
            RuleError: There is no such file, or it is not in the project. The call then fails even if the rule catches
                the error; check with `exists` first.
        """
        return self.file(path).data

    def file(self, path: str) -> File:
        """Like `read`, for a file that may not fit into memory."""
        return self._reading(path).file(path)

    def glob(self, pattern: str) -> list[str]:
        """Project files whose path matches, sorted; adding or removing a match makes the result stale.

        `*`, `?` and `[...]` match characters of one name, `**` between slashes matches any number of folders. Names
        that begin with a dot match only patterns that begin with one.
        """
        return self._reading(pattern).glob(pattern)

    def exists(self, path: str) -> bool:
        """Whether the project has a file or folder at `path`; the result becomes stale when this changes."""
        return self._reading(path).exists(path)

    def _reading(self, name: str) -> Reads:
        if self._reads is None:
            raise RuleError(
                f"a rule that declares no discoveries reads `{name}`",
                code="DXB-B350",
                hint="`@rule(..., discovers=True)`, or make the file an input",
            )
        return self._reads

    def check(self, holds: bool, message: str, *, hint: str | None = None, **facts: object) -> None:
        """Check a post-condition; the result is not published if it fails.

        Raises:
            RuleError: `holds` is false.
        """
        if not holds:
            raise RuleError(message, code="DXB-B201", hint=hint, facts=facts)

    def fail(self, message: str, *, hint: str | None = None, **facts: object) -> NoReturn:
        """Fail because the rule cannot handle these inputs.

        Raises:
            RuleError: Always.
        """
        raise RuleError(message, code="DXB-B202", hint=hint, facts=facts)

    def say(self, line: str) -> None:
        """Set the line about the result in the build log: `1 hinge, 0-131 deg`."""
        self.outcome.line = line

    def warn(self, text: str) -> None:
        """Add a warning about the result, which the build log and the report show below its line.

        The rule returns its result all the same: unusable results are refused by `fail` or `check`.
        """
        self.outcome.warnings.append(" ".join(text.split()))

    def preview(self, pixels: np.ndarray, caption: str = "") -> None:
        """Add a picture to the report: (H, W, 3) uint8 sRGB."""
        from dextera_build.artifacts.cameras.image import png

        self.outcome.previews.append((caption, png(pixels, level=1)))

    def metric(self, name: str, value: float, unit: str = "") -> None:
        """Add a number to the report and `dxb show`."""
        self.outcome.metrics[name] = (float(value), unit)

    def progress(self, done: int, total: int, what: str = "") -> None:
        """Report progress to the live console."""
        self._emit("progress", {"done": done, "total": total, "what": what})

    def log(self, text: str) -> None:
        """Add a line to `dxb log`."""
        self._emit("log", {"text": text})
