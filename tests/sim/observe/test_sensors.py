"""Sensors: what arrives late, seldom and with errors, against the exact measurements."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras
from dextera_build.policy import layout
from dextera_build.policy.observation import Frame, Measurement
from dextera_build.policy.terms import Sensor
from dextera_build.sim.observe.sensors import Sensors, check
from tests import episodes, task_bundles

HERE = layout.of_bundle(task_bundles.lift())
PERIOD_S = 0.05


def truth(step: int) -> Measurement:
    """Numbers that say the step."""
    poses = np.tile([float(step), 0, 0, 1, 0, 0, 0], (2, 1))
    return Measurement(np.full(5, float(step)), poses, np.full(1, float(step)))


def shown(sensors: dict[str, Sensor], steps: int = 40, seed: int = 0) -> list[Measurement]:
    made = Sensors(HERE.terms(sensors=sensors), {})
    made.reset(seed)
    return [made.measure(truth(step), step * PERIOD_S) for step in range(steps)]


def test_without_sensors_the_measurement_itself_passes():
    exact = truth(3)
    assert Sensors(HERE.terms(), {}).measure(exact, 0.15) is exact


def test_a_delay_shows_what_was_there_then():
    found = [seen.joints[0] for seen in shown({"joints": Sensor(delay_s=2 * PERIOD_S)})]
    assert found == [0, 0, *range(38)]


def test_a_slow_sensor_holds_its_last_sample():
    found = [seen.joints[0] for seen in shown({"joints": Sensor(rate_hz=5.0)}, 12)]
    assert found == [0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8]
    # Fifteen a second on a control rate of twenty: three of four periods have a new one.
    found = [seen.joints[0] for seen in shown({"joints": Sensor(rate_hz=15.0)}, 40)]
    assert len(set(found)) == 30


@pytest.mark.medium
def test_errors_have_the_stated_size_and_follow_from_the_seed():
    sensors = {"joints": Sensor(sigma=0.01), "objects": Sensor(sigma=0.002, turn_sigma_rad=0.02)}
    found = shown(sensors, 600)
    errors = np.array([seen.joints - step for step, seen in enumerate(found)])
    assert errors.std() == pytest.approx(0.01, rel=0.1)
    assert abs(errors.mean()) < 0.001
    poses = np.array([seen.objects for seen in found])
    assert (poses[..., 0] - np.arange(600)[:, None]).std() == pytest.approx(0.002, rel=0.1)
    assert np.allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0)
    assert (poses[..., 3] >= 0).all()
    angles = 2 * np.arccos(np.clip(poses[..., 3], -1, 1))
    assert np.sqrt((angles**2).mean()) == pytest.approx(0.02 * np.sqrt(3), rel=0.1)
    again = shown(sensors, 600)
    assert all(np.array_equal(one.objects, other.objects) for one, other in zip(found, again, strict=True))
    # Another term's sensor changes nothing, another seed everything.
    alone = shown({"joints": sensors["joints"]}, 600)
    assert all(np.array_equal(one.joints, other.joints) for one, other in zip(found, alone, strict=True))
    assert not np.array_equal(shown(sensors, 1, seed=1)[0].joints, found[0].joints)


def test_points_have_the_errors_and_holes_of_their_depth():
    lens = episodes.view(64, 48).camera
    k = lens.matrix()
    terms = HERE.terms({"front": lens}, {"depth": Sensor(depth=DepthNoise(dropout=0.2))})
    made = Sensors(terms, {"front": k})
    made.reset(4)
    depth = np.full((48, 64), 1.0, np.float32)
    frame = Frame(np.full((48, 64, 3), 128, np.uint8), depth, cameras.backproject(depth, k).astype(np.float32))
    exact = Measurement(np.zeros(5), np.zeros((2, 7)), np.zeros(1), {"front": frame})
    seen = made.measure(exact, 0.0).frames["front"]
    assert seen.depth is not None
    assert seen.cloud is not None
    assert 0.1 < (seen.depth == 0).mean() < 0.5
    assert not np.array_equal(seen.depth[seen.depth > 0], depth[seen.depth > 0])
    assert np.allclose(seen.cloud, cameras.backproject(seen.depth, k), atol=1e-6)
    assert seen.rgb is frame.rgb


@pytest.mark.parametrize(
    ("name", "message", "hint"),
    [
        ("contact", "`contact` is privileged, so that no sensor measures it", "leave it out of `sensors`"),
        ("objcts", "`objcts` is nothing that a sensor measures", "did you mean `objects`?"),
        ("depth/side", "`depth/side` is nothing that a sensor measures", "did you mean `depth`?"),
        ("goal", "`goal` is nothing that a sensor measures", "leave it out of `sensors`"),
    ],
)
def test_a_sensor_of_what_is_not_measured_is_refused(name: str, message: str, hint: str):
    with pytest.raises(RuleError) as caught:
        check({name: Sensor(sigma=0.1)}, ["front"])
    assert (caught.value.code, caught.value.message, caught.value.hint) == ("DXB-B514", message, hint)
    assert caught.value.facts == {"sensors": "depth, depth/front, displacement, joints, objects, rgb, rgb/front"}
