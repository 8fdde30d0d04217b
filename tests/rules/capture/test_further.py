"""Further photographs in `capture.json`: what is read, and the error of every wrong list."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner

from .test_folder import COUNTS, RGB, facts, files

OTHER = np.full_like(RGB, 90)
LEFT = {"rgb": "left.png", "depth": "left_depth.png"}


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def listed(*photographs: object, **more: bytes) -> Folder:
    changes = {"capture.json": facts(photographs=list(photographs)), "left.png": png(OTHER)}
    return files(**{**changes, "left_depth.png": png(COUNTS), **more})


def refused(runner: RuleRunner, folder: Folder) -> RuleError:
    with pytest.raises(RuleError) as caught:
        runner.run("capture.further", folder=folder)
    assert caught.value.hint
    return caught.value


def test_photographs_are_read_like_the_first_one(runner):
    pose = np.eye(4)
    pose[0, 3] = 0.2
    found = runner.run("capture.further", folder=listed({**LEFT, "T_first_camera": pose.tolist()}))
    (left,) = found.items
    assert (left.file, left.pose.parent, left.pose.child) == ("left.png", "camera", "further")
    assert np.array_equal(left.pose.matrix, pose)
    assert np.array_equal(left.capture.photograph.rgb.pixels, OTHER)
    assert left.capture.measured.depth.depth[1, 1] == np.float32(0.75)
    assert left.capture.photograph.camera == runner.run("capture.folder", folder=files()).photograph.camera


def test_one_photograph_has_no_further_ones(runner):
    assert runner.run("capture.further", folder=files()).items == ()
    assert runner.outcome.line == "one photograph only"
    assert runner.run("capture.further", folder=listed()).items == ()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("left.png", r"`photographs\[0\]` must be an object"),
        ({**LEFT, "fx": 7.0}, r"`photographs\[0\]` has fields that are not known"),
        ({"rgb": "left.png"}, r"`photographs\[0\]` has no depth"),
        ({**LEFT, "rgb": "right.png"}, r"`photographs\[0\]`: the file of `rgb` is missing"),
        ({**LEFT, "depth": "right_depth.png"}, r"`photographs\[0\]`: the file of `depth` is missing"),
        ({**LEFT, "rgb": "rgb.png"}, r"`photographs\[0\]` is a photograph that is there already"),
        ({**LEFT, "T_first_camera": np.diag([2.0, 2, 2, 1]).tolist()}, "`T_first_camera` is no rigid motion"),
        ({**LEFT, "T_first_camera": [[1, 0], [0, 1]]}, "`T_first_camera` is no rigid motion"),
    ],
)
def test_a_wrong_entry_is_one_error_with_its_place(runner, entry, message):
    error = refused(runner, listed(entry))
    assert "capture.json" in error.message
    with pytest.raises(RuleError, match=message):
        raise error


def test_a_photograph_listed_twice_names_the_other_one(runner):
    error = refused(runner, listed(LEFT, {**LEFT, "rgb": "copy.png"}, **{"copy.png": png(OTHER)}))
    assert "`photographs[1]` is a photograph that is there already" in error.message
    assert error.facts == {"photograph": "copy.png", "same_as": "left.png"}


def test_a_photograph_of_another_size_is_of_another_camera(runner):
    error = refused(runner, listed(LEFT, **{"left.png": png(np.zeros((12, 16, 3), np.uint8))}))
    assert error.message == "the intrinsics do not match the image size"
    assert error.facts["left.png"] == "16 x 12 px"


def test_the_list_must_be_one(runner):
    error = refused(runner, files(**{"capture.json": json.dumps({"photographs": "left.png"}).encode()}))
    assert "`photographs` must be a list" in error.message
