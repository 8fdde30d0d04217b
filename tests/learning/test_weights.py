"""Weights as bytes."""

from __future__ import annotations

import pickle

import pytest
import torch
from torch import nn

from dextera_build.errors import RuleError
from dextera_build.learning import weights


def layer(inputs: int = 3) -> nn.Module:
    torch.manual_seed(0)
    return nn.Linear(inputs, 2)


def test_weights_come_back_bit_for_bit():
    first, second = layer(), nn.Linear(3, 2)
    data = weights.to_bytes(first.state_dict())
    weights.fill(second, weights.from_bytes(data))
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    assert weights.to_bytes(second.state_dict()) == data


def test_the_order_of_names_leaves_the_bytes_alone():
    state = layer().state_dict()
    assert weights.to_bytes(dict(reversed(state.items()))) == weights.to_bytes(state)


def test_a_pickle_is_not_opened():
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return pytest.fail, ("a pickle was opened",)

    with pytest.raises(RuleError, match="the weights are not a safetensors file"):
        weights.from_bytes(pickle.dumps(Trap()))


@pytest.mark.parametrize("cut", [0, 5, 60, -1])
def test_a_file_that_was_cut_short_is_refused(cut: int):
    with pytest.raises(RuleError, match="the weights are not a safetensors file"):
        weights.from_bytes(weights.to_bytes(layer().state_dict())[:cut])


def test_one_error_names_all_that_does_not_fit():
    state = layer(4).state_dict()
    state["more"] = state.pop("bias")
    state["weight"][0, 0] = torch.nan
    with pytest.raises(RuleError, match="the weights do not fit the network that the contract describes") as caught:
        weights.fill(layer(), state)
    assert caught.value.facts == {
        "missing": "bias",
        "unknown": "more",
        "other shapes": "weight is 2 x 4, not 2 x 3",
        "not finite": "weight",
    }
