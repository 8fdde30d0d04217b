"""`rule`, which declares a function as the rule of its file, and the declaration."""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, ParamSpec, TypeVar, get_args, get_origin

from dextera_build.artifacts.base import Artifact
from dextera_build.rule.options import Options

P = ParamSpec("P")
R = TypeVar("R", bound=Artifact)


ROUNDING = 1e-9
"""Tolerance of numbers that only rounding sets apart, in any unit: processors add in another order, or without rounding
the product in between. docs/benchmarks/processors.md has the differences that were measured."""


@dataclass(frozen=True)
class Tolerance:
    """Allowed differences of numbers if a rule runs again on the same inputs; everything else must be equal.

    `Tolerance({"": 1e-9, "mesh.vertices": 1e-6, "weights": math.inf}, metrics={"volume": 1e-9})`
    """

    fields: Mapping[str, float] = field(default_factory=dict)
    """Field of the result, without labels and indices -> maximum absolute difference, in the unit of the field.

    It holds for all fields inside, unless they have their own; "" is the whole result. A field of infinite tolerance is
    not compared, whatever its type and shape.
    """
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Name of a metric -> maximum absolute difference, in the unit of the metric. Other metrics are not compared."""

    def of(self, name: str) -> float:
        """The maximum difference of a field: its own, or that of the closest field around it."""
        while name and name not in self.fields:
            name = name.rpartition(".")[0]
        return self.fields.get(name, 0.0)


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
    runs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    folders: Mapping[str, str] = field(default_factory=dict)
    typed_by: str = ""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the plain function."""
        return self.function(*args, **kwargs)

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    @property
    def untyped(self) -> tuple[str, ...]:
        """Parameters without a type, and `return` if that of the result is not said."""
        said = inspect.signature(self.function)
        names = tuple(name for name, each in said.parameters.items() if each.annotation is inspect.Parameter.empty)
        return names if said.return_annotation is not inspect.Signature.empty else (*names, "return")

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
    def protocol(self) -> type[Any] | None:
        """The `Protocol` of its backends, `MeshBackend` of a rule that takes `ctx: Context[MeshBackend]`."""
        hint = next(iter(typing.get_type_hints(self.function).values()))
        return next(iter(get_args(hint)), None)

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

    def returned(self, options: Mapping[str, Any]) -> Any:
        """The artifact type of the result under these options: of several, the one that the option `typed_by` names."""
        named = options.get(self.typed_by) if self.typed_by else None
        return next((kind for kind in get_args(self.returns) if kind.__name__ == named), self.returns)


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
    runs: Mapping[str, str | tuple[str, ...]] | None = None,
    folders: Mapping[str, str] | None = None,
    typed_by: str = "",
) -> Callable[[Callable[P, R]], Rule[P, R]]:
    """Declare the decorated function as the rule of its file; both must have the same name.

    The function takes `ctx: Context`, artifacts (its inputs; `X | None = None` makes one optional), and by keyword
    `options: <Options class>`.

    Args:
        version: Increment it when the meaning changes without a change of the code digest.
        packages: Distributions that must be installed. Their versions enter the key, as those of all distributions that
            the code imports and those of the chosen backend do.
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
        runs: Inputs that are run by code next to the rules that made them, `{"checkpoint": "policy"}` for `policy.py`,
            `{"terms": ""}` for the files of these rules, or in the folder that an option of these rules names;
            `ctx.companion` gives it. It is part of the key.
        folders: Options that name a folder of code, `{"primitive": "primitives"}`: `primitive: lift` is the folder
            `primitives/lift/`, whose `primitive.py` is part of the key and defines `Options`, set as `lift: {...}`;
            `ctx.named` gives both.
        typed_by: Option that names the type of the result, one of those that the function may return.
    """
    for name in resources or {}:
        if ":" not in name:
            raise ValueError(f"a named resource is called `kind:name`, not `{name}`")

    def mark(function: Callable[P, R]) -> Rule[P, R]:
        if unknown := (runs or {}).keys() - inspect.signature(function).parameters:
            raise ValueError(f"`runs` names {sorted(unknown)}, which `{function.__name__}` does not take")
        needs = (cpus, memory_gb, gpus, dict(resources or {}))
        run = {slot: (files,) if isinstance(files, str) else files for slot, files in (runs or {}).items()}
        again = (retries, retry_on, retry_wait_s)
        code = (run, dict(folders or {}), typed_by)
        return Rule(function, version, packages, *needs, *again, tolerance or Tolerance(), discovers, *code)

    return mark


def _without_none(annotation: Any) -> Any:
    if get_origin(annotation) in (typing.Union, types.UnionType):
        return typing.Union[tuple(part for part in get_args(annotation) if part is not type(None))]  # noqa: UP007
    return annotation
