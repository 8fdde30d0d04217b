"""Chooses the backend of a call: the one that the command line, the recipe or the profile prefers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from dextera_build.code.loader import BackendFile, RuleFile
from dextera_build.code.machine import Machine
from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.expect import STAND_INS
from dextera_build.recipe.profiles import Profile
from dextera_build.recipe.scope import Scope
from dextera_build.recipe.strict_yaml import Node


@dataclass(frozen=True)
class Wish:
    """Backends in order of preference, from the command line or a recipe."""

    names: tuple[str, ...]
    origin: str
    """`recipe`, `command line`, or the inputs that a backend is for."""
    where: Place


def given_of(bound: Mapping[str, Node], scope: Scope) -> Iterator[str]:
    """Names of the inputs that a call gives, without those bound to an input of the recipe that is not given."""
    for name, node in bound.items():
        if not isinstance(node.value, str) or scope.resolve(node.value, node.place).input is not None:
            yield name


def taking(found: RuleFile, inputs: Iterable[str], profile: Profile) -> tuple[str, ...]:
    """The backends of a rule that are for one of the given inputs, see `Backend.takes`.

    None where the profile's own are stand-ins, because a stand-in made what they would read besides.
    """
    able = {name: {*backend.facts.takes} for name, backend in found.backends.items() if backend.facts.takes}
    if not able or profile.preferred(found)[1] == STAND_INS:
        return ()
    given = {*inputs}
    return tuple(name for name, takes in able.items() if takes & given)


@dataclass(frozen=True)
class Choice:
    """The backend of a call."""

    backend: BackendFile
    why: str
    """`profile cpu`, `recipe`; with the skipped backends: `profile gpu; sam3 is missing: needs transformers`."""
    missing: tuple[str, ...] = ()
    """Its requirements that this machine lacks; empty if it can run."""
    hint: str | None = None
    """The next step if something is missing."""
    passed: tuple[str, ...] = ()
    """Preferred backends that are missing."""


def choose(
    found: RuleFile, wish: Wish | None, profile: Profile, where: Place, machine: Machine, *, fallback: bool
) -> Choice | None:
    """The backend of a rule; None for a rule without backends.

    A backend that this machine cannot run is chosen all the same, and a build refuses it: it takes the next in line
    only if a recipe lists one or allows it for the whole recipe.

    Args:
        found: The rule.
        wish: Backends named for this call; None: those of the profile.
        profile: The build's profile.
        where: Place of the call.
        machine: The machine that plans the build.
        fallback: Whether a profile's next backend may take the place of a missing one.

    Raises:
        RecipeError: There is no backend of a name, or the profile has none for the rule.
    """
    if wish is not None:
        names, origin, where = wish.names, wish.origin, wish.where
    elif not found.backends:
        return None
    else:
        names, source = profile.preferred(found)
        origin = f"profile {profile.name}" + (f" ({source})" if source != profile.name else "")
        if not names:
            raise RecipeError(
                f"no backend of {found.path} belongs to the profile `{profile.name}`",
                code="DXB-R204",
                where=where,
                facts={"backends": listing(found.backends)},
                hint=f"name one: `backend: {next(iter(found.backends))}`",
            )
    line = [backend_of(found, name, origin, where) for name in names]
    lacks = {backend.name: lacks_of(found, backend, machine) for backend in line[: None if fallback or wish else 1]}
    chosen = next((backend for backend in line if not lacks.get(backend.name, True)), line[0])
    passed = line[: line.index(chosen)]
    told = [origin, *(f"{other.name} is missing: needs {listing(lacks[other.name])}" for other in passed)]
    told += ["on the CPU"] if chosen.facts.gpu_gb and not machine.device_gb(chosen.facts) else []
    missing = tuple(lacks[chosen.name])
    hint = _next_step(found, lacks[chosen.name], chosen, line, machine) if missing else None
    return Choice(chosen, "; ".join(told), missing, hint, tuple(other.name for other in passed))


def with_used(found: RuleFile, backend: BackendFile) -> list[BackendFile]:
    """A backend, and those that it uses.

    Raises:
        RecipeError: The rule has no such backend.
    """
    where, origin = Place(str(backend.file)), f"`uses` of backend `{backend.name}`"
    return [backend, *(backend_of(found, name, origin, where) for name in backend.facts.uses)]


def lacks_of(found: RuleFile, backend: BackendFile, machine: Machine) -> dict[str, str]:
    """Requirements of a backend, or of one that it uses, that the machine lacks -> the next step.

    Raises:
        RecipeError: The rule has no backend of a name in `uses`.
    """
    return {what: step for each in with_used(found, backend) for what, step in each.lacks(machine).items()}


def backend_of(found: RuleFile, name: str, origin: str, where: Place) -> BackendFile:
    """The backend of this name; `origin` is the source of the name.

    Raises:
        RecipeError: The rule has no such backend.
    """
    if name not in found.backends:
        raise RecipeError(
            f"`{found.path}` has no backend `{name}`",
            code="DXB-R202",
            where=where,
            facts={"backends": listing(found.backends), "named by": origin},
            hint=did_you_mean(name, found.backends),
        )
    return found.backends[name]


def _next_step(
    found: RuleFile, lacks: Mapping[str, str], chosen: BackendFile, line: list[BackendFile], machine: Machine
) -> str:
    steps = ", ".join(dict.fromkeys(lacks.values()))
    others = [backend.name for backend in line if backend is not chosen and not lacks_of(found, backend, machine)]
    return steps + (f"; or `fallback: true` in the recipe takes `{others[0]}`" if others else "")
