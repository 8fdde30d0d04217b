"""The interface for authors of rules: `rule`, `Options`, `Context`, `Backend`.

A rule is a function from artifacts to one artifact, alone in a file of the same name. The decorator registers nothing:
it returns a `Rule`, and the loader finds it by its path.
"""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, ParamSpec, Protocol, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field

from dextera_build.artifacts.base import Artifact, File
from dextera_build.calls import Response as Response
from dextera_build.errors import RuleError

if TYPE_CHECKING:
    import numpy as np

P = ParamSpec("P")
R = TypeVar("R", bound=Artifact)


Fraction = Annotated[float, Field(ge=0, le=1)]
"""A number from 0 to 1: a fraction, a probability, a colour channel."""


class Options(BaseModel):
    """Options of a rule: typed, frozen, every field in the key. Nested groups also derive from this class.

    Declare bounds and choices with pydantic: `wall_m: PositiveFloat = 0.003`, `crf: int = Field(18, ge=0, le=51)`,
    `Literal["png", "jpeg"]`. Planning refuses invalid values; bounds are not part of the key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Backend:
    """Description of a backend, in literals so that it can be read without importing the file.

    A backend of rule `mesh` called `primitives` is the file `mesh_primitives.py` next to `mesh.py` with a module-level
    `BACKEND = Backend(...)`. The rule documents which functions it must define.
    """

    summary: str
    """One line for `dxb ls backends`."""
    profiles: tuple[str, ...] = ()
    """Profiles that select it: `stub`, `cpu`, `gpu`, `cloud`."""
    packages: tuple[str, ...] = ()
    """Distributions that it uses; their versions enter the key."""
    extra: str = ""
    """Extra of dextera-build that installs them."""
    gpu_gb: float = 0.0
    """Required GPU memory [GiB]."""
    weights: tuple[str, ...] = ()
    """`name@sha256` of model weights; these enter the key."""
    licence: str = "Apache-2.0"
    """Licence of code and weights."""


@dataclass
class Outcome:
    """Line, previews and metrics of a rule, in addition to its result."""

    line: str = ""
    previews: list[tuple[str, bytes]] = field(default_factory=list)
    metrics: dict[str, tuple[float, str]] = field(default_factory=dict)


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


class Context:
    """Services for a running rule.

    Args:
        backend: The chosen backend's module, or None for a rule without backends.
        scratch: A private folder of this call, removed afterwards; or a function that creates it on first use.
        emit: Takes (kind, data) messages as they occur: `progress`, `log`.
        keep: See the property `keep`; None for a folder below `scratch`.
        calls: Executes `call`; None if no recorder exists.
        reads: Reads files of the project; None for a rule that does not declare `discovers`.
    """

    def __init__(
        self,
        backend: Any = None,
        *,
        scratch: Path | Callable[[], Path],
        emit: Callable[[str, Mapping[str, object]], None] | None = None,
        keep: Path | Callable[[], Path] | None = None,
        calls: Callable[..., bytes] | None = None,
        reads: Reads | None = None,
    ) -> None:
        self.backend = backend
        self._scratch = scratch
        self.outcome = Outcome()
        self._emit = emit or (lambda kind, data: None)
        self._keep = keep
        self._calls = calls
        self._reads = reads

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

    def call(
        self,
        service: str,
        request: Mapping[str, Any],
        send: Callable[[float], bytes | Response],
        *,
        valid: Callable[[bytes], object] | None = None,
        timeout_s: float = 60.0,
        tries: int = 4,
        wait_s: float = 1.0,
        secrets: tuple[str, ...] = (),
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
            valid: Raises `ValueError` or a `RuleError` for a body that is not an answer; it is not recorded.
            timeout_s: Timeout passed to `send` [s].
            tries: Maximum number of tries.
            wait_s: Delay before the second try [s], doubled before each further one; `Retry-After` takes precedence.
            secrets: Texts that must not occur in the request or the answer, in addition to the values of variables
                such as `SERVICE_API_KEY`.

        Raises:
            DxbError: No answer is recorded and requests are not allowed, or the service gives no answer.
        """
        if self._calls is None:
            raise RuleError("nothing records calls here", code="DXB-B348", facts={"service": service})
        return self._calls(
            service,
            request,
            send,
            valid=valid,
            timeout_s=timeout_s,
            tries=tries,
            wait_s=wait_s,
            secrets=secrets,
        )

    def check(self, holds: bool, message: str, *, hint: str | None = None, **facts: object) -> None:
        """Check a post-condition; the result is not published if it fails.

        Raises:
            RuleError: `holds` is false.
        """
        if not holds:
            raise RuleError(message, code="DXB-B201", hint=hint, facts=facts)

    def fail(self, message: str, *, hint: str | None = None, **facts: object) -> typing.NoReturn:
        """Fail because the rule cannot handle these inputs.

        Raises:
            RuleError: Always.
        """
        raise RuleError(message, code="DXB-B202", hint=hint, facts=facts)

    def say(self, line: str) -> None:
        """Set the line about the result in the build log: `1 hinge, 0-131 deg`."""
        self.outcome.line = line

    def preview(self, pixels: np.ndarray, caption: str = "") -> None:
        """Add a picture to the report: (H, W, 3) uint8 sRGB."""
        from dextera_build.artifacts.image import png

        self.outcome.previews.append((caption, png(pixels)))

    def metric(self, name: str, value: float, unit: str = "") -> None:
        """Add a number to the report and `dxb show`."""
        self.outcome.metrics[name] = (float(value), unit)

    def progress(self, done: int, total: int, what: str = "") -> None:
        """Report progress to the live console."""
        self._emit("progress", {"done": done, "total": total, "what": what})

    def log(self, text: str) -> None:
        """Add a line to `dxb log`."""
        self._emit("log", {"text": text})


@dataclass(frozen=True)
class Tolerance:
    """Allowed differences of numbers if a rule runs again on the same inputs; everything else must be equal.

    `Tolerance({"vertices": 1e-6, "parts.mesh.vertices": 1e-6}, metrics={"volume": 1e-9})`
    """

    fields: Mapping[str, float] = field(default_factory=dict)
    """Field of the result, without labels and indices -> maximum absolute difference, in the unit of the field."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Name of a metric -> maximum absolute difference, in the unit of the metric. Other metrics are not compared."""


@dataclass(frozen=True)
class Slot:
    """One input of a rule."""

    name: str
    annotation: Any
    """`Mesh`, `Collection[Asset]`, `Image | Mesh`, ... without the `| None` of an optional input."""
    optional: bool


@dataclass(frozen=True)
class Rule(Generic[P, R]):
    """A rule function with its declarations, callable like the function itself."""

    function: Callable[P, R]
    version: int
    packages: tuple[str, ...]
    cpus: int = 1
    memory_gb: float = 1.0
    gpus: int = 0
    resources: Mapping[str, float] = field(default_factory=dict)
    retries: int = 0
    retry_on: tuple[type[BaseException] | str, ...] = ()
    retry_wait_s: float = 1.0
    tolerance: Tolerance = Tolerance()
    discovers: bool = False

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the plain function."""
        return self.function(*args, **kwargs)

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    @cached_property
    def slots(self) -> dict[str, Slot]:
        """Inputs by name, in order."""
        hints = typing.get_type_hints(self.function, include_extras=True)
        found = {}
        for name, parameter in list(inspect.signature(self.function).parameters.items())[1:]:
            if name == "options":
                continue
            annotation = hints[name]
            optional = parameter.default is not inspect.Parameter.empty
            found[name] = Slot(name, _without_none(annotation), optional)
        return found

    @cached_property
    def takes_options(self) -> bool:
        """Whether the function has an `options` parameter."""
        return "options" in inspect.signature(self.function).parameters

    @cached_property
    def options(self) -> type[Options]:
        """The options class; `Options` itself if the rule has none."""
        kind = typing.get_type_hints(self.function).get("options", Options)
        return typing.cast(type[Options], _without_none(kind))

    @cached_property
    def returns(self) -> Any:
        """The artifact type of the result."""
        return typing.get_type_hints(self.function, include_extras=True)["return"]


def rule(  # noqa: PLR0913 - one argument per declaration
    *,
    version: int,
    packages: tuple[str, ...] = (),
    cpus: int = 1,
    memory_gb: float = 1.0,
    gpus: int = 0,
    resources: Mapping[str, float] | None = None,
    retries: int = 0,
    retry_on: tuple[type[BaseException] | str, ...] = (ConnectionError, TimeoutError),
    retry_wait_s: float = 1.0,
    tolerance: Tolerance | None = None,
    discovers: bool = False,
) -> Callable[[Callable[P, R]], Rule[P, R]]:
    """Declare the decorated function as the rule of its file; both must have the same name.

    The function takes `ctx: Context`, then artifacts (its inputs; `X | None = None` makes one optional), then, by
    keyword, `options: <Options class>`.

    Args:
        version: Increment it when the meaning changes without a change of the code digest.
        packages: Third-party distributions that the result depends on; their versions enter the key. Those of the
            chosen backend are added.
        cpus: Cores that one call keeps busy, reserved from `--jobs` while it runs.
        memory_gb: Peak memory of one call [GiB]; once a node has run here, its measured peak counts instead.
        gpus: Exclusive GPUs of one call. A backend declares GPU memory in its `BACKEND`.
        resources: Named resources of limited number, `{"licence:solver": 1}`; a project sets their number in
            `[resources]`.
        retries: Maximum retries of a call whose worker died, whose machine lacked something (`MachineError`), or that
            raised one of `retry_on`. Refused inputs and failed checks are never retried.
        retry_on: Exceptions, or their names (`"httpx.TransportError"`) if the import is slow.
        retry_wait_s: Delay before the second try [s]; doubled before each further one, at most a minute.
        tolerance: Differences between results that `dxb check` accepts; None for none. Builds do not use it: the first
            result of a key stays.
        discovers: Whether calls discover the project files they read, with `ctx.read`, `ctx.glob`, `ctx.exists`.
    """
    for name in resources or {}:
        if ":" not in name:
            raise ValueError(f"a named resource is called `kind:name`, not `{name}`")

    def mark(function: Callable[P, R]) -> Rule[P, R]:
        named = dict(resources or {})
        allowed = tolerance or Tolerance()
        needs = (cpus, memory_gb, gpus, named)
        return Rule(function, version, packages, *needs, retries, retry_on, retry_wait_s, allowed, discovers)

    return mark


def _without_none(annotation: Any) -> Any:
    if get_origin(annotation) in (typing.Union, types.UnionType):
        return typing.Union[tuple(part for part in get_args(annotation) if part is not type(None))]  # noqa: UP007
    return annotation
