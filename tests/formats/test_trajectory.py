"""Trajectories: interpolation, checks, and TUM text."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation, Slerp

from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.errors import ArtifactError
from tests.artifacts.generated import values


def turning(*, covariances: bool = False) -> Trajectory:
    """Half a turn about z in two seconds, while it moves 2 m along x; in between q changes its sign."""
    turns = Rotation.from_euler("z", [[0], [90], [180]], degrees=True).as_quat(scalar_first=True)
    turns[1] *= -1
    places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    spread = np.stack([scale * np.eye(6) for scale in (1.0, 2.0, 3.0)]) if covariances else None
    stamps = np.array([10.0, 11.0, 12.0])
    return Trajectory(
        parent="world", child="camera", stamps=stamps, poses=np.hstack([places, turns]), covariances=spread
    )


@pytest.mark.parametrize("stamp", [10.0, 10.25, 11.0, 11.5, 12.0])
def test_it_is_interpolated_as_scipy_does(stamp):
    path = turning(covariances=True)
    pose = path.at(stamp)
    wanted = Slerp(path.stamps, Rotation.from_quat(path.poses[:, 3:], scalar_first=True))(stamp)
    assert np.allclose(pose.matrix[:3, :3], wanted.as_matrix(), atol=1e-12)
    assert np.allclose(pose.matrix[:3, 3], [stamp - 10, 0, 0])
    assert np.allclose(pose.covariance, (stamp - 9) * np.eye(6))
    assert (pose.parent, pose.child, pose.stamp) == ("world", "camera", stamp)


def test_it_is_not_extrapolated():
    with pytest.raises(ArtifactError, match=r"does not cover 12.1 s") as caught:
        turning().at(12.1)
    assert caught.value.code == "DXB-A504"
    assert caught.value.facts == {"from": "10.0 s", "to": "12.0 s"}


@given(values(Trajectory))
def test_tum_holds_everything(tmp_path_factory, path):
    file = tmp_path_factory.mktemp("tum") / "path.txt"
    path.save(file)
    again = Trajectory.load(file)
    assert (again.parent, again.child) == (path.parent, path.child)
    assert (again.stamps == path.stamps).all()
    assert np.allclose(again.poses, path.poses, rtol=0, atol=1e-15)
    assert (again.covariances is None) == (path.covariances is None)
    assert path.covariances is None or np.allclose(again.covariances, path.covariances, rtol=1e-12)


def test_a_file_of_the_benchmark_is_read(tmp_path):
    """Rounded quaternions x y z w, comments, epoch times."""
    file = tmp_path / "groundtruth.txt"
    file.write_text(
        "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n"
        "1305031098.6659 1.3563 0.6305 1.6380 0.6132 0.5962 -0.3311 -0.3986\n"
        "1305031098.6758 1.3543 0.6306 1.6360 0.6129 0.5966 -0.3316 -0.3980\n"
    )
    path = Trajectory.load(file, parent="mocap")
    assert (path.parent, path.child) == ("mocap", "camera")
    wanted = Rotation.from_quat([0.6132, 0.5962, -0.3311, -0.3986]).as_matrix()
    assert np.allclose(path.at(1305031098.6659).matrix[:3, :3], wanted, atol=1e-12)
    assert np.isclose(path.length_m(), np.linalg.norm([0.002, -0.0001, 0.002]))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no pose"),
        ("1 2 3\n", "line 1 holds 3 numbers where 8"),
        ("# c\n1 2 3 4 5 6 7 eight\n", "line 2 holds a word that is no number"),
        ("1 0 0 0 0 0 0 nan\n", "8 finite ones"),
        ("1 0 0 0 0 0 0 2\n", "the quaternion of pose 1 has length 2 instead of 1"),
        (f"# covariance {' '.join(21 * '1')}\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n", "1 covariances for 2 poses"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, text, why):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(ArtifactError, match=r"`a.txt` cannot be read as TUM") as caught:
        Trajectory.load(tmp_path / "a.txt")
    assert why in caught.value.facts["why"]


@pytest.mark.parametrize(
    ("fields", "code", "said"),
    [
        ({"stamps": np.array([1.0, 3.0, 3.0])}, "DXB-A501", "stamps do not increase"),
        ({"poses": np.full((3, 7), 0.5) * 1.01}, "DXB-A502", "3 of 3 quaternions"),
        ({"covariances": np.stack(3 * [-np.eye(6)])}, "DXB-A204", "not symmetric and positive"),
        ({"stamps": np.zeros(0), "poses": np.zeros((0, 7))}, "DXB-A503", "needs a pose"),
    ],
)
def test_poses_that_make_no_path_are_refused(fields, code, said):
    good = {name: getattr(turning(), name) for name in Trajectory.model_fields}
    with pytest.raises(ArtifactError, match=said) as caught:
        Trajectory(**good | fields)
    assert caught.value.code == code


def test_it_shows_its_size_and_path():
    assert list(turning().facts()) == ["T_world_camera", "3 poses", "2.00 s", "2.000 m"]
    assert turning().picture().startswith(b"\x89PNG")
