"""Tracks of objects: what is lost has no pose, and CSV holds everything."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from dextera_build.artifacts.spatial.track import Track
from dextera_build.errors import ArtifactError
from dextera_build.formats import track as track_files
from tests.artifacts.core.test_forms import same
from tests.artifacts.generated import values

POSE = [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]
GOOD = {
    "parent": "camera",
    "child": "mug",
    "stamps": np.array([0.0, 0.1, 0.2]),
    "poses": np.array([POSE, 7 * [np.nan], POSE]),
    "status": ("tracked", "lost", "predicted"),
}


@given(values(Track))
def test_csv_holds_everything(tmp_path_factory, track):
    file = tmp_path_factory.mktemp("csv") / "track.csv"
    track.save(file)
    again = Track.load(file)
    assert np.allclose(again.poses, track.poses, rtol=0, atol=1e-15, equal_nan=True)
    for name in ("parent", "child", "stamps", "status"):
        assert same(getattr(again, name), getattr(track, name))
    assert (again.covariances is None) == (track.covariances is None)
    assert track.covariances is None or np.allclose(again.covariances, track.covariances, rtol=1e-12)


def test_it_counts_what_was_found():
    track = Track(**GOOD)
    assert list(track.facts()) == ["T_camera_mug", "3 stamps", "0.20 s", "1 tracked", "1 predicted", "1 lost"]
    assert track_files.csv(track).splitlines()[2] == "camera,mug,0.1,,,,,,,,lost"
    assert track.picture().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("fields", "code", "said"),
    [
        ({"status": ("tracked", "lost")}, "DXB-A505", "2 statuses for 3 stamps"),
        ({"status": ("tracked", "tracked", "tracked")}, "DXB-A506", "at 0.1 s does not fit its status `tracked`"),
        ({"poses": np.array([POSE, POSE, POSE])}, "DXB-A506", "at 0.1 s does not fit its status `lost`"),
        ({"stamps": np.array([0.0, 0.2, 0.1])}, "DXB-A501", "do not increase"),
    ],
)
def test_rows_that_make_no_track_are_refused(fields, code, said):
    with pytest.raises(ArtifactError, match=said) as caught:
        Track(**GOOD | fields)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda text: text.splitlines()[0], "no row"),
        (lambda text: text.replace("status", "state"), "no column status"),
        (lambda text: text.replace("mug", "cup", 1), "2 pairs of frames"),
        (lambda text: text.replace("predicted", "guessed"), "`guessed` is not one of tracked"),
        (lambda text: text.replace("0.3", "far", 1), "line 2: `z` is no finite number"),
        (lambda text: text.replace("1.0", "3.0", 1), "the quaternion of pose 1 has length 3"),
        (lambda text: text.replace("1.0", "", 1), "line 2: `qw` is no finite number"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, change, why):
    (tmp_path / "a.csv").write_text(change(track_files.csv(Track(**GOOD))))
    with pytest.raises(ArtifactError, match=r"`a.csv` cannot be read as CSV of a Track") as caught:
        Track.load(tmp_path / "a.csv")
    assert why in caught.value.facts["why"]
