"""The names that authors of rules use: `rule`, `Options`, `Context`, `Backend`.

A rule is a function from artifacts to one artifact, alone in a file that bears its name. The decorator registers
nothing: it returns a `Rule`, and the loader finds it by its path.
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
"""A part of a whole, a probability, a colour's channel."""


class Options(BaseModel):
    """Options of a rule: typed, frozen, every field in the key. Nested groups derive from it too.

    Bounds and choices are those of pydantic: `wall_m: PositiveFloat = 0.003`, `crf: int = Field(18, ge=0, le=51)`,
    `Literal["png", "jpeg"]`. A value outside is refused when the recipe is planned; bounds are in no key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Backend:
    """A backend file's description of itself, in literals, so that it is read without importing the file.

    A backend of rule `mesh` called `primitives` is the file `mesh_primitives.py` beside `mesh.py` with a module-level
    `BACKEND = Backend(...)`. Which functions it has to offer is stated by the rule.
    """

    summary: str
    """One line for `dxb ls backends`."""
    profiles: tuple[str, ...] = ()
    """Profiles that choose it: `stub`, `cpu`, `gpu`, `cloud`."""
    packages: tuple[str, ...] = ()
    """Distributions it runs; their versions enter the key."""
    extra: str = ""
    """Extra of dextera-build that installs them."""
    gpu_gb: float = 0.0
    """GPU memory that it needs [GiB]."""
    weights: tuple[str, ...] = ()
    """`name@sha256` of model weights; they enter the key."""
    licence: str = "Apache-2.0"
    """Licence of code and weights."""


@dataclass
class Outcome:
    """A rule's line, previews and metrics, beside its result."""

    line: str = ""
    previews: list[tuple[str, bytes]] = field(default_factory=list)
    metrics: dict[str, tuple[float, str]] = field(default_factory=dict)


class Reads(Protocol):
    """Files of the project for one call; see `Context.read`."""

    def file(self, path: str) -> File:
        """The file at `path`."""
        ...

    def glob(self, pattern: str) -> list[str]:
        """Files that match."""
        ...

    def exists(self, path: str) -> bool:
        """Whether there is something at `path`."""
        ...


class Context:
    """Services for a rule besides computing.

    Args:
        backend: The chosen backend's module, or None for a rule without backends.
        scratch: A folder of this call alone, removed afterwards; or a function that makes it on first use.
        emit: Takes (kind, data) as it happens: `progress`, `log`.
        keep: See the property `keep`; None is a folder below `scratch`.
        calls: Carries out `call`; None if no recorder exists.
        reads: Reads files of the project, and gives `File`s by digest; None for a rule that does not declare it.
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
        """A folder of this call alone, removed afterwards."""
        return self._scratch if isinstance(self._scratch, Path) else self._scratch()

    @property
    def keep(self) -> Path:
        """A folder of this very call that outlives a kill, a failure and Ctrl-C, so that the next build can go on.

        Empty at first; removed when the call's result is in the store, and never part of it: a call that went on must
        return the bytes that it would have returned in one go. A kill may come at any moment, so write a file aside and
        rename it.
        """
        kept = self._keep() if callable(self._keep) else self._keep
        folder = kept or self.scratch / "keep"
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def read(self, path: str) -> bytes:
        """The content of a file of the project, named from the project's folder.

        What a call reads this way need not be an input: it is noted, in order, and the result counts as long as all of
        it is as it was. The rule declares `discovers=True`.

        Raises:
            RuleError: There is no such file, or it is not in the project. The call then has no result, also where the
                rule goes on; `exists` asks first.
        """
        return self.file(path).data

    def file(self, path: str) -> File:
        """Like `read`, for a file that need not fit into memory."""
        return self._reading(path).file(path)

    def glob(self, pattern: str) -> list[str]:
        """Files of the project whose path matches, sorted; a file that comes or goes makes the result stale.

        `*`, `?` and `[...]` match characters of one name, `**` between slashes matches any number of folders. Names
        that begin with a dot match only a pattern that does.
        """
        return self._reading(pattern).glob(pattern)

    def exists(self, path: str) -> bool:
        """Whether the project has a file or folder there; the result is stale when that changes."""
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
        """The answer of a service that is not part of the build: a model in a cloud, a generator behind an API.

        The answer is recorded under the digest of `service` and `request`. Where one is recorded nothing is sent, so a
        build can be repeated without a network and for nothing.

        Args:
            service: Name of the service, never its address.
            request: All that the answer depends on, as plain data; bytes count by their digest. No key, host or time.
            send: Called with the seconds it may take where no answer is recorded; adds host and key, and returns the
                body or a `Response` with the status. What it raises of `OSError` or httpx's transport errors is tried
                again, and so are 429 and 5xx.
            valid: Raises `ValueError` or a `RuleError` for a body that is not an answer; it is not recorded.
            timeout_s: What `send` is given [s].
            tries: How often it is asked at most.
            wait_s: Rest before the second try [s], doubled before each further one; `Retry-After` takes precedence.
            secrets: What must stand neither in the request nor in the answer, beside the values of variables such as
                `SERVICE_API_KEY`.

        Raises:
            DxbError: No answer is recorded and none may be asked for; or the service gives none.
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
        """A post-condition: nothing is published where it does not hold.

        Raises:
            RuleError: `holds` is false.
        """
        if not holds:
            raise RuleError(message, code="DXB-B201", hint=hint, facts=facts)

    def fail(self, message: str, *, hint: str | None = None, **facts: object) -> typing.NoReturn:
        """Stop because these inputs cannot be worked with.

        Raises:
            RuleError: Always.
        """
        raise RuleError(message, code="DXB-B202", hint=hint, facts=facts)

    def say(self, line: str) -> None:
        """The one line about the result that the build log shows: `1 hinge, 0-131 deg`."""
        self.outcome.line = line

    def preview(self, pixels: np.ndarray, caption: str = "") -> None:
        """A picture for the report: (H, W, 3) uint8 sRGB."""
        from dextera_build.artifacts.image import png

        self.outcome.previews.append((caption, png(pixels)))

    def metric(self, name: str, value: float, unit: str = "") -> None:
        """A number for the report and `dxb show`."""
        self.outcome.metrics[name] = (float(value), unit)

    def progress(self, done: int, total: int, what: str = "") -> None:
        """How far the work is, for the live console."""
        self._emit("progress", {"done": done, "total": total, "what": what})

    def log(self, text: str) -> None:
        """A line for `dxb log`."""
        self._emit("log", {"text": text})


@dataclass(frozen=True)
class Tolerance:
    """How far the numbers of a result may be apart when a rule runs again on the same inputs; all else is exact.

    `Tolerance({"vertices": 1e-6, "parts.mesh.vertices": 1e-6}, metrics={"volume": 1e-9})`
    """

    fields: Mapping[str, float] = field(default_factory=dict)
    """Field of the result, without labels and indices -> largest absolute difference, in the unit of the field."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Name given to `ctx.metric` -> largest absolute difference, in the unit of the metric. Others are not compared."""


@dataclass(frozen=True)
class Slot:
    """One input of a rule."""

    name: str
    annotation: Any
    """`Mesh`, `Collection[Asset]`, ... without the `| None` of an optional input."""
    optional: bool


@dataclass(frozen=True)
class Rule(Generic[P, R]):
    """A rule function with its declarations; called like the function itself."""

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
        """The options class; an empty one where the rule has none."""
        kind = typing.get_type_hints(self.function).get("options", Options)
        return typing.cast(type[Options], _without_none(kind))

    @cached_property
    def returns(self) -> Any:
        """The artifact type that comes out."""
        return typing.get_type_hints(self.function, include_extras=True)["return"]


def rule(  # noqa: PLR0913 - all that a rule may declare
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
    """Declare the function below as the rule that its file is named after.

    The function takes `ctx: Context`, then artifacts (its inputs; `X | None = None` makes one optional), then, by
    keyword, `options: <Options class>`.

    Args:
        version: Raise it when the meaning changes although the code digest does not show it.
        packages: Third-party distributions that the result depends on; their versions enter the key. Those of the
            chosen backend are added.
        cpus: Cores that one call keeps busy; so many of `--jobs` are not given to others meanwhile.
        memory_gb: Peak memory of one call [GiB]; once a node has run here, its measured peak counts instead.
        gpus: GPUs that one call has to itself. A backend declares GPU memory in its `BACKEND`.
        resources: Named things of which there are only so many, `{"licence:solver": 1}`; a project says how many in
            `[resources]`.
        retries: How often a call is tried again whose worker died, whose machine lacked something (`MachineError`), or
            that raised one of `retry_on`. A refused input and a failed check are never tried again.
        retry_on: Exceptions, or their names (`"httpx.TransportError"`) where the import would be heavy.
        retry_wait_s: Rest before the second try [s]; twice as long before each further one, a minute at most.
        tolerance: How far results may be apart for `dxb check`; None is exact. A build never takes one for another: the
            first result of a key stays.
        discovers: Whether a call finds out for itself which files of the project it reads: `ctx.read`, `ctx.glob`,
            `ctx.exists`.
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
        return next(part for part in get_args(annotation) if part is not type(None))
    return annotation
