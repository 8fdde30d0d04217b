"""The code that a call is given: its backend, the backends that this one uses, companions of its inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dextera_build.code.companions import Companions, each_of
from dextera_build.code.loader import RuleFile
from dextera_build.errors import RuleError, did_you_mean, listing
from dextera_build.rule import Options
from dextera_build.rule.chosen import Chosen


def as_called(found: RuleFile, backend: str | None) -> Chosen | None:
    """What a rule is given as `ctx.backend`."""
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
        named = companions.get(slot, {})
        if name not in named:
            said = f"the rule must name what it makes after its folder or file: {listing(named)}" if named else None
            raise RuleError(
                f"what runs `{name}` of the input `{slot}` is not beside a rule that made it",
                code="DXB-B385",
                facts={each.name: f"{each.file.name} beside {each.rule}" for each in named.values()},
                hint=did_you_mean(name, named) or said or f"`@rule(runs={{{slot!r}: ...}})`; `RuleRunner(made_by=...)`",
            )
        found = named[name]
        return Chosen(found.module, protocol, f"`{found.file.name}` beside {found.rule}")

    return companion


def roots(found: RuleFile, backend: str | None, companions: Companions) -> list[str]:
    """The packages under which the code of a call is mounted, in the order in which its sources name them."""
    used = [found.backends[name] for name in (backend, *found.backends[backend].facts.uses)] if backend else []
    every = (found.root, *(each.root for each in used), *(each.root for each in each_of(companions)))
    return list(dict.fromkeys(root.name for root in every))
