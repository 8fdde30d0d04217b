"""Action noise: its spread, its smoothness, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import Aim, Command
from dextera_build.sim.experts.noise import FADE, Disturbance, Noise
from tests import factories

LOUD = Noise(position_m=0.01, rotation_rad=0.02, finger_rad=0.03)


def command(contact: bool = False) -> Command:
    return Command({"arm": Aim(factories.pose(0.3, 0.1, 0.2, yaw=0.3), np.zeros(4))}, "grasp", "box", contact)


def shifts(noise: Noise, count: int, seed: int = 2) -> np.ndarray:
    """Displacements of the palm along x (count,)."""
    disturbance = Disturbance(noise, seed)
    made = [disturbance.on(command()).aims["arm"].palm[0, 3] for _ in range(count + FADE)]
    return np.array(made[FADE:]) - 0.3


def test_noise_has_the_declared_spread_and_stays_a_rotation() -> None:
    disturbance = Disturbance(Noise(0.01, 0.02, 0.03, correlation=0.0), seed=1)
    clean = command().aims["arm"]
    made = [disturbance.on(command()).aims["arm"] for _ in range(4000)]
    assert np.array([one.palm[:3, 3] - clean.palm[:3, 3] for one in made]).std(axis=0) == pytest.approx(0.01, rel=0.1)
    turns = [transforms.angle(clean.palm[:3, :3].T @ one.palm[:3, :3]) for one in made]
    assert np.sqrt(np.mean(np.square(turns)) / 3) == pytest.approx(0.02, rel=0.1)
    assert np.array([one.fingers for one in made]).std() == pytest.approx(0.03, rel=0.1)
    assert all(abs(np.linalg.det(one.palm[:3, :3]) - 1) < 1e-9 for one in made[:50])


@pytest.mark.medium
def test_correlated_noise_keeps_its_spread_from_the_first_step_on() -> None:
    found = shifts(Noise(position_m=0.01, correlation=0.9), 8000)
    assert found.std() == pytest.approx(0.01, rel=0.15)
    assert np.corrcoef(found[:-1], found[1:])[0, 1] == pytest.approx(0.9, abs=0.03)
    early = np.array([shifts(Noise(position_m=0.01, correlation=0.97), 2, seed) for seed in range(300)])
    assert early.std(axis=0) == pytest.approx(0.01, rel=0.15)


def test_the_velocity_of_noise_is_correlated_too() -> None:
    velocity = np.diff(shifts(Noise(position_m=0.01, correlation=0.97), 4000))
    # Zero would be a first-order process, which shakes the arm.
    assert np.corrcoef(velocity[:-1], velocity[1:])[0, 1] > 0.5


def test_noise_fades_at_a_contact_and_is_off_in_it_unless_asked() -> None:
    disturbance, clean = Disturbance(LOUD, 3), command(contact=True).aims["arm"].palm
    assert np.array_equal(disturbance.on(command(contact=True)).aims["arm"].palm, clean)
    free = [disturbance.on(command()).aims["arm"].palm[0, 3] for _ in range(60)]
    fading = [disturbance.on(command(contact=True)).aims["arm"].palm for _ in range(FADE)]
    assert not np.array_equal(fading[0], clean)
    assert np.array_equal(fading[-1], clean)
    path = np.array([*free, *(palm[0, 3] for palm in fading)])
    assert np.abs(np.diff(path)).max() < 0.01
    everywhere = Disturbance(Noise(position_m=0.01, in_contact=True), 3)
    assert not np.array_equal(everywhere.on(command(contact=True)).aims["arm"].palm, clean)


def test_noise_is_over_when_a_contact_that_was_announced_begins() -> None:
    disturbance, clean = Disturbance(LOUD, 3), command().aims["arm"].palm
    for _ in range(20):
        disturbance.on(command())
    for _ in range(FADE):
        disturbance.on(replace(command(), nears=True))
    assert np.array_equal(disturbance.on(command(contact=True)).aims["arm"].palm, clean)
    jumping = Disturbance(LOUD, 3)
    for _ in range(20 + FADE):
        jumping.on(command())
    assert not np.array_equal(jumping.on(command(contact=True)).aims["arm"].palm, clean)


def test_no_noise_is_the_command_itself() -> None:
    assert np.allclose(Disturbance(Noise(), 4).on(command()).aims["arm"].palm, command().aims["arm"].palm)


def test_a_limb_that_joins_does_not_make_the_other_jump() -> None:
    alone, joined = Disturbance(LOUD, 5), Disturbance(LOUD, 5)
    both = Command({**command().aims, "other": Aim(factories.pose(), np.zeros(4))}, "grasp", "box")
    before = [alone.on(command()).aims["arm"].palm[:3, 3] for _ in range(20)][-1]
    assert np.allclose([joined.on(command()).aims["arm"].palm[:3, 3] for _ in range(20)][-1], before)
    assert np.abs(joined.on(both).aims["arm"].palm[:3, 3] - before).max() < 0.01
