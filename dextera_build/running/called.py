"""The code that a call is given: its backend, the backends that this one uses, companions of its inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from dextera_build import digest as digests
from dextera_build.code.companions import Companions, each_of, in_folder
from dextera_build.code.loader import Library, RuleFile
from dextera_build.errors import RuleError, did_you_mean, listing
from dextera_build.rule import Options
from dextera_build.rule.chosen import Chosen


def as_called(found: RuleFile, backend: str | None) -> Chosen | None:
    """The value of `ctx.backend`."""
    if not backend:
        return None
    return Chosen(found.backends[backend].module, found.rule.protocol, f"backend `{backend}` of {found.path}")


def others(found: RuleFile, backend: str | None) -> Callable[[str], tuple[Any, Options]] | None:
    """Returns the module and the default options of a backend that another one uses; None for a rule without any."""
    if backend is None:
        return None
    uses = found.backends[backend].facts.uses

    def other(name: str) -> tuple[Any, Options]:
        if name not in uses:
            raise RuleError(
                f"backend `{backend}` of {found.path} does not declare that it uses `{name}`",
                code="DXB-B381",
                facts={"declared": listing(uses)},
                hint=f'`BACKEND = Backend(..., uses=("{name}",))`',
            )
        file = found.backends[name]
        return as_called(found, name), (file.options or Options)()

    return other


def running(companions: Companions) -> Callable[[str, str, type[Any]], Any]:
    """Returns a companion as a rule is given it; see `Context.companion`."""

    def companion(slot: str, name: str, protocol: type[Any]) -> Any:
        named = {each.name: each for each in companions.get(slot, ())}
        if name not in named:
            said = f"the rule must name its result after its folder or file: {listing(named)}" if named else None
            raise RuleError(
                f"no rule that made the input `{slot}` has a companion `{name}`",
                code="DXB-B385",
                facts={each.name: str(each) for each in named.values()},
                hint=did_you_mean(name, named) or said or f"`@rule(runs={{{slot!r}: ...}})`; `RuleRunner(made_by=...)`",
            )
        return Chosen(named[name].module, protocol, str(named[name]))

    return companion


def named(found: RuleFile, given: Mapping[str, Any]) -> dict[str, tuple[str, bytes]]:
    """Option that names a folder -> that name, and the options of the folder as canonical JSON.

    Args:
        found: The rule.
        given: All options of the call as JSON data.
    """
    names = {option: given[option] for option in found.rule.folders}
    return {option: (name, digests.canonical(given.get(name, {}))) for option, name in names.items()}


@contextmanager
def only_keyed(companions: Companions) -> Iterator[None]:
    """In the block, of the code that is found by name, only that in the key of the call: primitives, but no formats."""
    from dextera_build.artifacts.core import above
    from dextera_build.sim.primitives import folders  # imports nothing else

    known = {(each.name, each.file.stem): each for each in each_of(companions)}

    def find(name: str, file: str) -> ModuleType:
        if (name, file) not in known:
            raise RuleError(
                f"`{file}.py` of primitive `{name}` is not in the key of this call",
                code="DXB-B386",
                facts={"in the key": listing(map(str, known.values())) or "none"},
                hint=f'declare the input that holds the task: `@rule(runs={{"bundle": "{file}"}})`',
            )
        return known[name, file].module

    with folders.only(find), above.refused():
        yield


@contextmanager
def shown(library: Library) -> Iterator[None]:
    """In the block, which is no call of a build, primitives of the project can be played, too."""
    from dextera_build.sim.primitives import folders  # imports nothing else

    def find(name: str, file: str) -> ModuleType:
        found = in_folder(library, f"primitives/{name}", file) if name.isidentifier() else None
        return found.module if found and found.file.is_file() else folders.own(name, file)

    with folders.only(find):
        yield


def roots(found: RuleFile, backend: str | None, companions: Companions) -> list[str]:
    """The packages under which the code of a call is mounted, in the order in which its sources name them."""
    used = [found.backends[name] for name in (backend, *found.backends[backend].facts.uses)] if backend else []
    beside = (each.root for each in each_of(companions) if each.root)
    every = (found.root, *(each.root for each in used), *beside)
    return list(dict.fromkeys(root.name for root in every))
