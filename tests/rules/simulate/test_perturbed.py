"""simulate.perturbed: what changes, what stays, and what cannot be stretched."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.geometry import massprops
from dextera_build.sim.worlds import perturb, settle
from dextera_build.testing import RuleRunner
from tests import factories, reference_tasks
from tests.reference_tasks import corners_of, opened, pose_of

SIZE = (0.06, 0.16, 0.21)
STILL = {"size_sigma": 0.0, "dynamics": 0.0, "hinge_sigma": 0.0, "centre_m": 0.0, "contact_sigma": 0.0}


def assets() -> dict[str, Asset]:
    return {
        "red_box": factories.box_asset(factories.pose(0.2, 0.0, 0.0, 0.3), SIZE, mass=0.4),
        "notebook": factories.laptop_asset(factories.pose(-0.2, 0.1), opening=1.9),
    }


@pytest.fixture(scope="module")
def twin() -> TaskBundle:
    return reference_tasks.bundle(assets())


def disturbed(folder: Path, twin: TaskBundle, **options: Any) -> TaskBundle:
    backend = options.pop("backend", "mujoco")
    made: TaskBundle = RuleRunner(folder).run("simulate.perturbed", backend=backend, options=options, bundle=twin)
    return made


def test_names_and_frames_stay_and_the_rest_changes(twin: TaskBundle, tmp_path: Path) -> None:
    made = disturbed(tmp_path, twin, seed=2)
    (before, home), (after, now) = opened(twin), opened(made)
    assert [after.body(n).name for n in range(after.nbody)] == [before.body(n).name for n in range(before.nbody)]
    assert [after.joint(n).name for n in range(after.njnt)] == [before.joint(n).name for n in range(before.njnt)]
    np.testing.assert_allclose(now.qpos, home.qpos, atol=1e-6)
    assert made.task == twin.task
    assert made.kind == "perturbed"
    for name in twin.objects:
        np.testing.assert_allclose(pose_of(now, name), pose_of(home, name), atol=1e-6)
        assert after.body(name).mass[0] != pytest.approx(before.body(name).mass[0], rel=1e-3)
        assert made.objects[name].friction != twin.objects[name].friction
        assert made.objects[name].friction_sigma == 0.0
        assert made.objects[name].mass_scale == (1.0, 1.0)
        np.testing.assert_array_equal(made.objects[name].points, twin.objects[name].points)
    assert after.opt.timestep == pytest.approx(0.001)
    assert after.actuator_gainprm[0, 0] != before.actuator_gainprm[0, 0]


@pytest.mark.medium
def test_draws_stay_inside_the_twins_intervals(twin: TaskBundle, tmp_path: Path) -> None:
    before, _ = opened(twin)
    for seed in range(8):
        made = disturbed(tmp_path, twin, seed=seed)
        after, _ = opened(made)
        ratio = after.body("red_box").mass[0] / before.body("red_box").mass[0]
        assert 0.7 <= ratio <= 1.4
        assert abs(made.objects["red_box"].friction - 0.5) <= 2 * 0.1 + 1e-9


def test_given_sizes_are_taken(twin: TaskBundle, tmp_path: Path) -> None:
    sizes = {"red_box": (1.1, 0.9, 1.05), "notebook": (1.02, 1.02, 1.02)}
    after, now = opened(disturbed(tmp_path, twin, **STILL, sizes=sizes))
    before, _ = opened(twin)
    local = corners_of(after, now, "red_box_collision_0") - now.body("red_box").xpos
    turned = local @ now.body("red_box").xmat.reshape(3, 3)
    np.testing.assert_allclose(np.ptp(turned, axis=0), np.multiply(SIZE, sizes["red_box"]), atol=1e-5)
    assert turned[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    # Same mass, stretched: the inertia is that of the larger box.
    x, y, z = np.multiply(SIZE, sizes["red_box"])
    expected = sorted(0.4 / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y]))
    np.testing.assert_allclose(sorted(after.body("red_box").inertia), expected, rtol=1e-4)
    assert after.body("red_box").ipos[2] == pytest.approx(SIZE[2] / 2 * 1.05, abs=1e-5)
    np.testing.assert_allclose(after.body("notebook_lid").pos, 1.02 * before.body("notebook_lid").pos, atol=1e-6)


def test_an_articulated_body_grows_evenly_and_still_closes(twin: TaskBundle, tmp_path: Path) -> None:
    after, now = opened(disturbed(tmp_path, twin, seed=5, size_sigma=0.05))
    scale = after.body("notebook_lid").pos[1] / 0.11
    assert scale != pytest.approx(1.0, abs=1e-3)
    now.joint("notebook_lid_hinge").qpos[0] = 0.0
    mujoco.mj_forward(after, now)
    lid = corners_of(after, now, "notebook_lid_collision_0")
    np.testing.assert_allclose(np.ptp(lid, axis=0), scale * np.array([0.32, 0.22, 0.006]), atol=1e-5)
    assert lid[:, 2].min() == pytest.approx(0.0165 * scale, abs=1e-5)


def test_it_stands_still(twin: TaskBundle, tmp_path: Path) -> None:
    made = disturbed(tmp_path, twin, seed=1)
    run = settle.let_go(made.model, tuple(made.objects), 1.0)
    for motion in run.motions:
        assert motion.drift_m < 0.002, motion
        assert motion.tilt_rad < np.radians(1.0), motion
        assert motion.joints < np.radians(1.0), motion


@pytest.mark.medium
def test_a_seed_is_a_world(twin: TaskBundle, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    one, same, other = (runner.encode(disturbed(tmp_path, twin, seed=seed)) for seed in (1, 1, 2))
    assert one == same
    assert one != other


def test_the_stub_has_the_same_form(twin: TaskBundle, tmp_path: Path) -> None:
    stub = disturbed(tmp_path, twin, backend="stub")
    assert stub.kind == "perturbed"
    assert list(stub.objects) == list(twin.objects)


def test_stretching_an_inertia_is_stretching_the_body() -> None:
    rng = np.random.default_rng(3)
    points, weights = rng.normal(size=(50, 3)), rng.uniform(1, 2, 50)
    factors = np.array([1.3, 0.8, 1.1])

    def inertia(at: np.ndarray) -> np.ndarray:
        square = (at**2).sum(1)[:, None, None] * np.eye(3)
        total: np.ndarray = np.einsum("n,nij->ij", weights, square - at[:, :, None] * at[:, None])
        return total

    stretched = perturb.stretch(inertia(points), factors)
    np.testing.assert_allclose(stretched, inertia(points * factors), rtol=1e-12)
    assert massprops.is_physical(stretched)


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ({"notebook": (1.1, 1.0, 1.0)}, "`notebook` has joints, so it can be scaled only evenly"),
        ({"teapot": (1.0, 1.0, 1.0)}, "the task has no object `teapot`"),
    ],
)
def test_impossible_sizes_are_refused(
    twin: TaskBundle, tmp_path: Path, sizes: dict[str, tuple[float, float, float]], message: str
) -> None:
    with pytest.raises(RuleError, match=message) as error:
        disturbed(tmp_path, twin, sizes=sizes)
    assert error.value.hint or "red_box" in str(error.value.facts["objects"])


def test_only_a_twin_is_disturbed(twin: TaskBundle, tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="this one is `perturbed`"):
        disturbed(tmp_path, disturbed(tmp_path, twin))
