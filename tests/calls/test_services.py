"""The table `[services.NAME]`: what it may say, how layers are merged, and what a call costs by it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.calls.services import Price, Service, over, parse, usd
from dextera_build.errors import RecipeError

AMOUNTS = st.floats(0, 1e3, allow_nan=False)
TOKENS = {"prompt_tokens": (2000.0, "tokens"), "completion_tokens": (500.0, "tokens")}


def test_a_service_has_limits_and_prices_by_model():
    table = {
        "chat": {"requests_per_minute": 60, "concurrent": 4, "usd_per_call": 1, "models": {"big": {"usd_per_call": 3}}}
    }
    service = parse(table, "dxb.toml")["chat"]
    assert (service.requests_per_minute, service.concurrent) == (60, 4)
    assert service.price_of("small").bound == 1.0
    assert service.price_of("big").bound == 3.0


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ([], "`services` is not a table"),
        ({"chat": 3}, "`services.chat` is not a table"),
        ({"chat": {"request_per_minute": 3}}, "`services.chat` has no field `request_per_minute`"),
        (
            {"chat": {"requests_per_minute": 0}},
            "`services.chat.requests_per_minute` is a whole number from 1 on, not `0`",
        ),
        ({"chat": {"concurrent": True}}, "`services.chat.concurrent` is a whole number from 1 on, not `True`"),
        ({"chat": {"usd_per_call": -1}}, "`services.chat.usd_per_call` is an amount in USD, not `-1`"),
        ({"chat": {"usd_per_call": math.nan}}, "`services.chat.usd_per_call` is an amount in USD, not `nan`"),
        ({"chat": {"models": {"big": {"concurrent": 2}}}}, "`services.chat.models.big` has no field `concurrent`"),
    ],
)
def test_what_a_table_cannot_say(table, message):
    with pytest.raises(RecipeError) as caught:
        parse(table, "dxb.toml")
    assert caught.value.code == "DXB-R404"
    assert caught.value.message == message
    assert str(caught.value.where) == "dxb.toml"


def test_an_unknown_field_has_a_hint():
    with pytest.raises(RecipeError) as caught:
        parse({"chat": {"request_per_minute": 3}}, "dxb.toml")
    assert caught.value.hint == "did you mean `requests_per_minute`?"


def test_layers_are_merged_by_field_and_model():
    below = {"chat": {"concurrent": 4, "models": {"big": {"usd_per_call": 3}}}, "forge": {"usd_per_call": 1}}
    above = {"chat": {"concurrent": 2, "models": {"small": {"usd_per_call": 1}}}}
    found = parse(over(below, above, "dxb.local.toml"), "both")
    assert found["chat"].concurrent == 2
    assert found["chat"].price_of("big").bound == 3.0
    assert found["chat"].price_of("small").bound == 1.0
    assert found["forge"].price.bound == 1.0
    assert below["chat"]["concurrent"] == 4


@pytest.mark.parametrize(
    ("price", "bound"),
    [
        (Price(), None),
        (Price(usd_per_call=0.02), 0.02),
        (Price(usd_per_call=0.0), 0.0),
        (Price(usd_per_million_input_tokens=2.0), None),
        (Price(usd_per_million_input_tokens=2.0, usd_per_call=0.5), None),
        (Price(usd_per_million_input_tokens=0.0), 0.0),
        (Price(usd_per_million_output_tokens=2.0, most_usd_per_call=0.1), 0.1),
    ],
)
def test_the_bound_of_a_price(price, bound):
    assert price.bound == bound


@given(AMOUNTS, AMOUNTS, AMOUNTS)
def test_tokens_and_calls_add_up(call, entered, left):
    price = Price(call, entered, left, 1e9)
    assert price.of(TOKENS) == pytest.approx(call + entered * 0.002 + left * 0.0005)


def test_what_the_service_says_counts_more_than_the_stated_price():
    assert Price(usd_per_call=1.0).of({"cost": (0.25, "USD")}) == 0.25
    assert Price().of({"cost": (0.25, "USD")}) == 0.25
    assert Price().of({}) is None


def test_a_service_that_counts_no_tokens_costs_the_bound():
    assert Price(usd_per_million_input_tokens=2.0, most_usd_per_call=0.1).of({}) == 0.1


def test_a_service_without_settings_has_no_limits():
    assert Service().price_of("any").bound is None


@given(st.floats(0, 1e6))
def test_amounts_are_shown_to_a_hundredth_of_a_cent(amount):
    assert usd(amount).endswith(" USD")
    assert float(usd(amount).split()[0]) == pytest.approx(amount, abs=0.0051 if amount >= 1 else 0.00006)
