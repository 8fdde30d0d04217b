"""Training on a GPU: as on the CPU but for rounding, and the same bytes each time. `make test-gpu` runs these tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tests import episodes
from tests.rules.learn.test_act import ACT
from tests.rules.learn.test_bc_rnn import RNN
from tests.rules.learn.test_diffusion import DIFFUSION
from tests.rules.learn.trainings import Trainings

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
ALL = pytest.mark.parametrize("kind", [ACT, DIFFUSION, RNN], ids=lambda kind: kind.rule)


@ALL
def test_the_same_inputs_give_the_same_bytes(kind: Trainings, tmp_path: Path) -> None:
    data = episodes.small(4)
    assert kind.learn(tmp_path, data, "cuda").weights == kind.learn(tmp_path, data, "cuda").weights


@ALL
def test_bfloat16_learns_the_same(kind: Trainings, tmp_path: Path) -> None:
    data = episodes.small(4)
    plain, fast = (kind.learn(tmp_path, data, "cuda", steps=8, bf16=bf16) for bf16 in (False, True))
    assert fast.weights != plain.weights
    np.testing.assert_allclose(fast.curve, plain.curve, rtol=0.1)


@ALL
def test_the_losses_are_those_of_the_cpu(kind: Trainings, tmp_path: Path) -> None:
    """Over few steps, because every step amplifies differences of rounding."""
    data = episodes.small(4)
    here, there = (kind.learn(tmp_path, data, backend, steps=8) for backend in ("torch", "cuda"))
    np.testing.assert_allclose(there.curve, here.curve, rtol=1e-2)


@ALL
def test_a_training_that_was_killed_ends_with_the_same_bytes(
    kind: Trainings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind.assert_resumes(tmp_path, monkeypatch, "cuda")
