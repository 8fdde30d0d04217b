"""The terms on which one command calls services: limits, prices, a limit of costs, consents.

Every build writes them for its workers, so this module does not import the code that sends requests.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dextera_build.calls.consent import EVERY
from dextera_build.calls.services import Service, parse
from dextera_build.calls.spending import Spending


@dataclass(frozen=True)
class Terms:
    """The terms on which one command calls services, the same in all its worker processes."""

    services: Mapping[str, Service] = field(default_factory=dict)
    spending: Spending | None = None
    """None: no limit of costs."""
    consents: Sequence[tuple[str, str]] = ((EVERY, EVERY),)
    """(service, kind of data) pairs that may be sent."""

    @classmethod
    def read(cls, text: str) -> Terms:
        """The terms that `written` spelled; "" for none."""
        told = json.loads(text or "{}")
        most = told.get("max_cost")
        spending = Spending(Path(told["ledger"]), float(most)) if most is not None else None
        consents = [(service, kind) for service, kind in told.get("consents", ())]
        return cls(parse(told.get("services", {}), "the build's settings"), spending, consents)


def written(
    services: Mapping[str, Any], max_cost: float | None, ledger: str, consents: Sequence[tuple[str, str]]
) -> str:
    """Terms as text for `Terms.read`.

    Args:
        services: The table of the settings.
        max_cost: The most that the command may spend [USD]; None: no limit.
        ledger: See `spending.open_ledger`.
        consents: See `consent.Consents.here`.
    """
    limit = {"max_cost": max_cost, "ledger": ledger} if max_cost is not None else {}
    return json.dumps({"services": services, "consents": consents, **limit})
