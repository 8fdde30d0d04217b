"""Windows of steps that learners train on."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dextera_build.learning.demonstrations import Demonstrations, Selection, prepare
from dextera_build.learning.parts import parts_of
from dextera_build.learning.samples import Samples, Window
from dextera_build.learning.training import averaged
from tests import episodes


@pytest.fixture(scope="module")
def data() -> Demonstrations:
    return prepare(
        episodes.bundle(), parts_of(episodes.small(3, 6)), Selection(("joints",)), algorithm="act", settings={}
    )


def test_a_window_stays_within_its_episode(data: Demonstrations) -> None:
    made = Samples(data, Window(range(-1, 4), range(-1, 1))).at(np.array([6, 8, 11]))
    rows = torch.tensor([[6, 6, 7, 8, 9], [7, 8, 9, 10, 11], [10, 11, 11, 11, 11]])
    assert torch.equal(made.actions, torch.from_numpy(data.actions)[rows])
    assert made.keep.tolist() == [[False, True, True, True, True], [True] * 5, [True, True, False, False, False]]
    seen = torch.from_numpy(data.inputs["joints"])[torch.tensor([[6, 6], [7, 8], [10, 11]])]
    assert torch.equal(made.inputs["joints"], seen)


def test_one_observed_step_has_no_axis_of_its_own(data: Demonstrations) -> None:
    made = Samples(data, Window(range(2))).at(np.array([0, 17]))
    assert made.inputs["joints"].shape == (2, *data.inputs["joints"].shape[1:])


def test_the_average_of_weights_forgets_where_it_began() -> None:
    network = torch.nn.Linear(1, 1, bias=False)
    average = averaged(network, 0.9)
    with torch.no_grad():
        for value in range(200):
            network.weight.fill_(float(value))
            average.update_parameters(network)
    # A constant decay d lags a ramp by d / (1 - d).
    assert float(average.module.weight.detach()) == pytest.approx(199 - 9, abs=0.1)
