"""Random changes of pictures: what they change, what they leave, and that a step always draws the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch
from torch import Tensor

from dextera_build.learning import augmentation
from dextera_build.learning.options import ImitationOptions

ALL = {"shift": 2, "crop": 0.3, "colour": 0.3, "blur_px": 1.5, "grain": 0.05}
Change = Callable[[Tensor, torch.Generator], Tensor]


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def pictures(count: int = 4) -> Tensor:
    """Smooth coloured pictures with a bright square."""
    rows, columns = torch.meshgrid(torch.linspace(-0.6, 0.4, 24), torch.linspace(-0.5, 0.5, 32), indexing="ij")
    one = torch.stack([rows, columns, -rows])
    one[:, 8:12, 10:16] = 0.8
    return one.expand(count, -1, -1, -1).clone()


def options(**chosen: float) -> ImitationOptions:
    return ImitationOptions.model_validate(chosen)


def test_without_options_nothing_is_drawn_and_nothing_changes() -> None:
    random, plain = seeded(), pictures()
    assert augmentation.augmented(plain, options(), random) is plain
    assert torch.equal(random.get_state(), seeded().get_state())


@pytest.mark.parametrize("name", [*ALL, "all"])
def test_a_step_draws_the_same_and_another_one_something_else(name: str) -> None:
    chosen = options(**(ALL if name == "all" else {name: ALL[name]}))
    first, again, other = (augmentation.augmented(pictures(), chosen, seeded(seed)) for seed in (3, 3, 4))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    assert not torch.equal(first[0], first[1]), "every picture is changed in its own way"
    assert first.shape == pictures().shape
    assert first.abs().max() <= 1.0
    assert not torch.equal(first, pictures())


@pytest.mark.parametrize(
    "change",
    [
        partial(augmentation.cropped, most=0.4),
        partial(augmentation.blurred, most_px=2.0),
        partial(augmentation.shifted, most=3),
    ],
    ids=["crop", "blur", "shift"],
)
def test_a_picture_of_one_colour_stays_as_it_is_wherever_it_is_looked_at(change: Callable[..., Tensor]) -> None:
    plain = torch.tensor([0.2, -0.4, 0.7]).view(1, 3, 1, 1).expand(3, 3, 24, 32).contiguous()
    assert torch.allclose(change(plain, random=seeded()), plain, atol=1e-5)


def test_a_crop_enlarges_a_window_inside_the_picture() -> None:
    """Columns are numbered by their brightness, so that a window shows what it holds."""
    columns = torch.linspace(-1.0, 1.0, 32).view(1, 1, 1, 32).expand(200, 3, 24, 32)
    found = augmentation.cropped(columns, 0.5, seeded())[:, 0, 0]
    spans = found[:, -1] - found[:, 0]
    assert 0.95 < float(spans.min()) < 1.1
    assert 1.9 < float(spans.max()) <= 2.0
    assert float(found[:, 0].min()) < -0.98
    assert float(found[:, 0].max()) > -0.3
    assert (found.diff(dim=1) >= -1e-6).all()


def test_colours_change_within_their_factor() -> None:
    grey = torch.zeros(500, 3, 2, 2)
    found = (augmentation.coloured(grey, 0.2, seeded()) + 1.0) / 2.0
    assert found.min() < 0.4
    assert found.max() > 0.6
    assert found.min() >= 0.5 * 0.8 * 0.8 - 0.1
    assert found.max() <= 0.5 * 1.2 * 1.2 + 0.1
    assert torch.allclose(found, found[:, :, :1, :1].expand_as(found), atol=1e-6), "the same in the whole picture"


def test_a_blur_keeps_the_mean_and_takes_away_what_is_sharp() -> None:
    random = torch.rand(8, 3, 64, 64, generator=seeded(1)) - 0.5
    found = augmentation.blurred(random, 3.0, seeded())
    spreads = found.std(dim=(1, 2, 3)) / random.std(dim=(1, 2, 3))
    assert float(spreads.max()) <= 1.0 + 1e-6
    assert float(spreads.min()) < 0.3
    assert torch.allclose(found.mean(dim=(1, 2, 3)), random.mean(dim=(1, 2, 3)), atol=0.02)


def test_grain_has_the_stated_spread() -> None:
    found = augmentation.augmented(torch.zeros(4, 3, 64, 64), options(grain=0.05), seeded())
    assert float(found.std()) == pytest.approx(2 * 0.05, rel=0.03)
