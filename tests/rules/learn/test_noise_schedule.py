"""The levels of noise of learn.diffusion, against their formulas and against another implementation."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.policy.policies import runner

SCHEDULE = runner("diffusion").network.schedule
SHARES = SCHEDULE.shares(100)


def test_the_share_of_the_sample_falls_along_a_squared_cosine() -> None:
    phase = (np.arange(1, 101) / 100 + 0.008) / 1.008
    start = np.cos(0.008 / 1.008 * np.pi / 2) ** 2
    np.testing.assert_allclose(SHARES[:-1], (np.cos(phase * np.pi / 2) ** 2 / start)[:-1], rtol=1e-5)
    assert float(SHARES[-1] / SHARES[-2]) == pytest.approx(0.001), "no level loses all"


def test_noised_samples_have_the_stated_mean_and_variance() -> None:
    random = torch.Generator().manual_seed(0)
    noise = torch.randn(200_000, generator=random)
    for level in (0, 30, 60, 99):
        mixed = SCHEDULE.noised(torch.full_like(noise, 0.7), noise, SHARES[level].expand(len(noise)))
        share = float(SHARES[level])
        assert float(mixed.mean()) == pytest.approx(0.7 * share**0.5, abs=0.01)
        assert float(mixed.var()) == pytest.approx(1 - share, rel=0.02, abs=1e-6)


def test_every_sample_has_its_own_level() -> None:
    samples, noise = torch.ones(2, 3, 4), torch.zeros(2, 3, 4)
    mixed = SCHEDULE.noised(samples, noise, SHARES[torch.tensor([0, 60])])
    np.testing.assert_allclose(mixed[:, 0, 0], SHARES[[0, 60]].sqrt())


@pytest.mark.parametrize("what", ["noise", "sample"])
@pytest.mark.parametrize("passes", [1, 3, 10, 100])
def test_who_knows_the_noise_or_the_sample_gets_the_sample_back(passes: int, what: str) -> None:
    random = torch.Generator().manual_seed(1)
    sample, start = 2 * torch.rand(5, 16, 3, generator=random) - 1, torch.randn(5, 16, 3, generator=random)
    asked = list[int]()

    def told(mixed: Tensor, level: int) -> Tensor:
        asked.append(level)
        return sample if what == "sample" else (mixed - SHARES[level].sqrt() * sample) / (1 - SHARES[level]).sqrt()

    np.testing.assert_allclose(SCHEDULE.denoised(start, SHARES, passes, told, what), sample, atol=1e-4)
    assert asked == SCHEDULE.visited(100, passes)
    assert len(asked) == passes
    assert asked[-1] == 0


def test_a_wrong_answer_stays_in_range() -> None:
    made = SCHEDULE.denoised(torch.zeros(1, 4), SHARES, 10, lambda mixed, level: torch.full_like(mixed, -9.0))
    assert float(made.max()) == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("what", "theirs_is"), [("noise", "epsilon"), ("sample", "sample")])
@pytest.mark.parametrize("passes", [7, 10, 16])
def test_it_agrees_with_diffusers(passes: int, what: str, theirs_is: str) -> None:
    diffusers = pytest.importorskip("diffusers")
    named = {"num_train_timesteps": 100, "beta_schedule": "squaredcos_cap_v2", "prediction_type": theirs_is}
    forward, back = diffusers.DDPMScheduler(**named), diffusers.DDIMScheduler(**named, clip_sample=True)
    torch.testing.assert_close(SHARES, forward.alphas_cumprod, rtol=1e-5, atol=1e-9)
    random = torch.Generator().manual_seed(2)
    sample, start = (torch.randn(2, 16, 3, generator=random) for _ in range(2))
    level = torch.tensor([10, 80])
    torch.testing.assert_close(
        SCHEDULE.noised(sample, start, SHARES[level]), forward.add_noise(sample, start, level), rtol=1e-4, atol=1e-5
    )
    back.set_timesteps(passes)
    theirs = start
    for step in back.timesteps:
        theirs = back.step(theirs.sin() * 0.9, step, theirs).prev_sample
    ours = SCHEDULE.denoised(start, SHARES, passes, lambda mixed, level: mixed.sin() * 0.9, what)
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-4)


def test_levels_are_told_apart() -> None:
    told = SCHEDULE.waves(torch.arange(100), 128)
    assert told.shape == (100, 128)
    gaps = torch.cdist(told, told) + torch.eye(100)
    assert float(gaps.min()) > 0.1
