"""Cost of the calls of a run, summed over its events."""

from __future__ import annotations

from dataclasses import dataclass, field

from dextera_build.calls.services import usd


@dataclass
class Costs:
    """The costs of a run by service."""

    by_service: dict[str, tuple[int, float]] = field(default_factory=dict)
    """Service -> number of requests, and their cost [USD]."""
    sure: bool = True
    """False: some answers were lost, and their requests may not have been charged."""

    def add(self, service: str, amount: float, *, sure: bool) -> None:
        """Add one request that cost `amount` [USD]."""
        number, total = self.by_service.get(service, (0, 0.0))
        self.by_service[service] = (number + 1, total + amount)
        self.sure = self.sure and sure

    @property
    def total(self) -> float:
        """The cost of all requests [USD]."""
        return sum(amount for _, amount in self.by_service.values())

    def __str__(self) -> str:
        """`0.0600 USD for 3 requests (forge 0.0500 USD, openai-chat 0.0100 USD)`; "" if nothing had a price."""
        if not self.by_service:
            return ""
        number = sum(requests for requests, _ in self.by_service.values())
        requests = "1 request" if number == 1 else f"{number:,} requests"
        each = ", ".join(f"{name} {usd(amount)}" for name, (_, amount) in self.by_service.items())
        named = f" ({each})" if len(self.by_service) > 1 else f" to {each.rpartition(' ')[0].rpartition(' ')[0]}"
        return f"{'' if self.sure else 'up to '}{usd(self.total)} for {requests}{named}"
