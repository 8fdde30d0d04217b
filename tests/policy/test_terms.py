"""Terms: the types of observations, spaces, features and topics follow from one declaration."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.policy import layout, seen
from dextera_build.policy.declared import BY_NAME, DECLARED
from dextera_build.policy.observation import Frame
from dextera_build.policy.terms import Sensor
from dextera_build.sim.runtime import privileged
from rules.demonstrate import lerobot_features
from tests import episodes
from tests.policy import policies

BUNDLE = episodes.bundle()


def names(reader: str, *, cameras: bool = False) -> set[str]:
    return {term.name for term in DECLARED if term.seen_by == reader and (term.rows == "cameras") == cameras}


def test_every_field_of_an_observation_is_declared_and_the_reverse():
    assert names("policies") == policies.observation().values.keys() == seen.MEASURES.keys()
    assert names("policies", cameras=True) == {field.name for field in dataclasses.fields(Frame)}
    assert names("critics") == privileged.MEASURES.keys()
    assert names("data sets") <= set(Episode.model_fields)
    assert {term.name for term in DECLARED if term.recorded} == episodes.episode().terms.keys()


def test_the_nine_modalities_of_the_paper_are_there():
    groups = {term.group for term in DECLARED} - {"record"}
    assert groups == {
        "policy", "proprioception", "state", "contact", "goal", "privileged", "rgb", "depth", "cloud",
    }  # fmt: skip
    assert {term.name for term in DECLARED if term.group == "state"} == {"objects", "displacement"}
    assert all(term.unit and term.about for term in DECLARED)


def test_terms_have_the_sizes_of_the_task_and_its_cameras():
    lenses = {"front": episodes.view(64, 48).camera, "side": episodes.view(32, 24).camera}
    found = {term.key: term for term in layout.of_bundle(BUNDLE).terms(lenses)}
    assert found["deployable/objects"].shape == (2, 7)
    assert found["deployable/objects"].components[7:9] == ("case.x", "case.y")
    assert found["privileged/tip_velocities"].shape == (2, 6)
    assert found["privileged/hand_poses"].components[0] == "x"
    assert found["privileged/points"].shape == (8, 3)
    assert found["deployable/rgb/side"].shape == found["deployable/cloud/side"].shape == (24, 32, 3)
    assert found["deployable/depth/front"].shape == (48, 64)
    assert all(term.rate_hz == 20.0 for term in found.values())


def test_a_sensor_belongs_to_its_term_or_to_one_camera():
    lenses = {"front": episodes.view().camera, "side": episodes.view().camera}
    sensors = {"objects": Sensor(rate_hz=15.0, delay_s=0.06), "depth/side": Sensor(rate_hz=5.0)}
    found = {term.key: term for term in layout.of_bundle(BUNDLE).terms(lenses, sensors)}
    assert (found["deployable/objects"].rate_hz, found["deployable/objects"].sensor.delay_s) == (15.0, 0.06)
    assert found["deployable/depth/side"].rate_hz == found["deployable/cloud/side"].rate_hz == 5.0
    assert found["deployable/depth/front"].rate_hz == found["deployable/joints"].rate_hz == 20.0


def test_features_of_a_data_set_are_the_terms_that_have_one():
    made = episodes.small(1)
    goal = layout.of_bundle(BUNDLE).goal
    features = lerobot_features.features(made, goal)
    vectors = {name for name, feature in features.items() if feature.names}
    assert vectors == {term.feature for term in DECLARED if term.feature and term.rows != "cameras"}
    assert features["observation.environment_state"].names == (
        *(f"{thing}.{part}" for thing in ("box", "case") for part in ("x", "y", "z", "qw", "qx", "qy", "qz")),
        "case_lid_hinge",
    )
    found = lerobot_features.columns(made, made.items["0"], 0, 0)
    assert {name: values.shape[1] for name, values in found.items()} == {n: f.width for n, f in features.items()}


@pytest.mark.parametrize(
    ("limbs", "topics"),
    [(("arm",), ["/target/hand"]), (("left", "right"), ["/target/left/hand", "/target/right/hand"])],
)
def test_a_robot_with_one_limb_needs_no_name_for_it(limbs, topics):
    here = dataclasses.replace(layout.of_bundle(BUNDLE), limbs=limbs)
    hand = next(term for term in here.terms() if term.declared is BY_NAME["hand"])
    assert [hand.topic(limb) for limb in limbs] == topics
    assert len(hand.components) == 7 * len(limbs)
    assert np.prod(hand.shape) == len(hand.components)
