"""Settings of services, `[services.NAME]`: limits of their use, and prices."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from dextera_build.calls.secrets import KEYRING, NAMES
from dextera_build.errors import Place, RecipeError, did_you_mean, listing

_MILLION = 1e6


@dataclass(frozen=True)
class Price:
    """Price of one call [USD]; None where nothing is stated."""

    usd_per_call: float | None = None
    usd_per_million_input_tokens: float | None = None
    usd_per_million_output_tokens: float | None = None
    most_usd_per_call: float | None = None
    """Upper bound of one call, needed where tokens cost something, because they are counted afterwards."""

    @property
    def is_stated(self) -> bool:
        """Whether anything is stated."""
        return any(getattr(self, one.name) is not None for one in fields(self))

    @property
    def bound(self) -> float | None:
        """The most that one call can cost [USD], or None if nothing bounds it."""
        if self.most_usd_per_call is not None:
            return self.most_usd_per_call
        if self.usd_per_million_input_tokens or self.usd_per_million_output_tokens:
            return None
        return self.usd_per_call if self.is_stated and self.usd_per_call is not None else self._free

    @property
    def _free(self) -> float | None:
        """0 if tokens are stated to cost nothing."""
        return 0.0 if self.is_stated else None

    def of(self, amounts: Mapping[str, tuple[float, str]]) -> float | None:
        """Cost of a call with these `asking.amounts` [USD]: as reported by the service, else by this price."""
        if "cost" in amounts:
            return amounts["cost"][0]
        if not self.is_stated:
            return None
        tokens = (
            (self.usd_per_million_input_tokens, "prompt_tokens"),
            (self.usd_per_million_output_tokens, "completion_tokens"),
        )
        if any(usd and name not in amounts for usd, name in tokens):
            return self.bound  # it does not report its number of tokens
        by_token = sum((usd or 0.0) * amounts[name][0] / _MILLION for usd, name in tokens if name in amounts)
        return (self.usd_per_call or 0.0) + by_token


@dataclass(frozen=True)
class Service:
    """Limits and prices of one service."""

    requests_per_minute: int | None = None
    concurrent: int | None = None
    """Most requests at a time; a job counts from its submission to its end."""
    price: Price = field(default_factory=Price)
    models: Mapping[str, Price] = field(default_factory=dict)
    """Model -> price, where it differs from that of the service."""

    def price_of(self, model: str) -> Price:
        """The price of a call that names `model`."""
        return self.models.get(model, self.price)


_PRICES = tuple(one.name for one in fields(Price))
_COUNTS = ("requests_per_minute", "concurrent")
_FIELDS = (*_COUNTS, *_PRICES, "models")


def parse(table: object, origin: str) -> dict[str, Service]:
    """The services of a table of the settings, by name.

    Raises:
        RecipeError: Not a table of tables, an unknown field, or a value that a field cannot have.
    """
    services = _table("services", table, origin)
    return {name: _service(name, _table(f"services.{name}", value, origin), origin) for name, value in services.items()}


def usd(amount: float) -> str:
    """`0.0200 USD`."""
    return f"{amount:.4f} USD" if amount < 1 else f"{amount:.2f} USD"


def over(below: Mapping[str, Any], above: object, origin: str) -> dict[str, Any]:
    """A table of services merged over that of a lower layer: field by field, and prices by model.

    Raises:
        RecipeError: See `parse`.
    """
    parse(above, origin)
    found = {name: dict(service) for name, service in below.items()}
    for name, service in _table("services", above, origin).items():
        known = found.setdefault(name, {})
        models = {**known.get("models", {}), **service.get("models", {})}
        known |= {**service, **({"models": models} if models else {})}
    return found


def _service(name: str, given: Mapping[str, Any], origin: str) -> Service:
    place = f"services.{name}"
    _refuse_unknown(place, given, _FIELDS, origin)
    models = _table(f"{place}.models", given.get("models", {}), origin)
    counts = {key: _count(f"{place}.{key}", given[key], origin) for key in _COUNTS if key in given}
    prices = {}
    for model, said in models.items():
        inner = f"{place}.models.{model}"
        table = _table(inner, said, origin)
        _refuse_unknown(inner, table, _PRICES, origin)
        prices[model] = _price(inner, table, origin)
    return Service(**counts, price=_price(place, given, origin), models=prices)


def _price(place: str, given: Mapping[str, Any], origin: str) -> Price:
    return Price(**{key: _usd(f"{place}.{key}", given[key], origin) for key in _PRICES if key in given})


def _table(place: str, value: object, origin: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _wrong(f"`{place}` is not a table", origin, hint="[services.NAME]")
    return value


def _refuse_unknown(place: str, given: Mapping[str, Any], known: tuple[str, ...], origin: str) -> None:
    for name in given:
        if NAMES.search(name) and "tokens" not in name:
            raise RecipeError(
                f"`{place}.{name}` would hold a secret, and files of settings are shared",
                code="DXB-R406",
                where=Place(origin),
                hint=f"`keyring set {KEYRING} NAME`, or a variable of the environment",
            )
        if name not in known:
            raise _wrong(
                f"`{place}` has no field `{name}`", origin, hint=did_you_mean(name, known), fields=listing(known)
            )


def _count(place: str, value: object, origin: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 1_000_000:
        raise _wrong(f"`{place}` is a whole number from 1 on, not `{value}`", origin)
    return value


def _usd(place: str, value: object, origin: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise _wrong(f"`{place}` is an amount in USD, not `{value}`", origin, hint=f"{place.rpartition('.')[2]} = 0.02")
    return float(value)


def _wrong(message: str, origin: str, hint: str | None = None, **facts: object) -> RecipeError:
    return RecipeError(message, code="DXB-R404", where=Place(origin), facts=facts, hint=hint)
