"""Rigs of cameras, and Kalibr's files of them."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.geometry import transforms
from tests.artifacts.generated import values

LEFT = {
    "camera_model": "pinhole",
    "intrinsics": [461.6, 460.3, 363.0, 248.1],
    "distortion_model": "radtan",
    "distortion_coeffs": [-0.28, 0.07, 0.0002, 0.00002],
    "resolution": [752, 480],
    "rostopic": "/left/image_raw",
}
APART = transforms.rigid(np.eye(3), np.array([-0.11, 0.0, 0.0]))
RIGHT = LEFT | {"distortion_model": "equidistant", "rostopic": "/right/image_raw", "T_cn_cnm1": APART.tolist()}


def load(tmp_path, fields):
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(fields))
    return Rig.load(tmp_path / "camchain.yaml")


def test_a_chain_of_kalibr_is_read(tmp_path):
    rig = load(tmp_path, {"cam0": LEFT, "cam1": RIGHT})
    assert isinstance(rig.cameras["left"], BrownConrady)
    assert isinstance(rig.cameras["right"], KannalaBrandt)
    assert np.allclose(rig.poses["left"].matrix, np.eye(4))
    assert np.allclose(rig.between("left", "right").matrix[:3, 3], [0.11, 0, 0])
    assert list(rig.facts()) == ["2 cameras (left, right)", "at most 110 mm apart"]
    assert rig.picture().startswith(b"\x89PNG")


def as_kalibr_has_them(rig: Rig) -> Rig:
    """The rig with lenses of four coefficients, which is what Kalibr knows."""
    none = dict.fromkeys(("k3", "k4", "k5", "k6"), 0.0)
    cameras = {
        label: lens.model_copy(update=none) if isinstance(lens, BrownConrady) else lens
        for label, lens in rig.cameras.items()
    }
    return rig.model_copy(update={"cameras": cameras})


@settings(max_examples=25)
@given(values(Rig).map(as_kalibr_has_them))
def test_a_camchain_holds_everything(tmp_path_factory, rig):
    kinds = rig.cameras.values()
    assume(rig.cameras and not any(isinstance(lens, Equirectangular) for lens in kinds))
    assert not any(lens.coefficients()[4:].any() for lens in kinds if isinstance(lens, BrownConrady))
    path = tmp_path_factory.mktemp("rig") / "camchain.yaml"
    rig.save(path)
    again = Rig.load(path)
    assert again.cameras == rig.cameras
    for label, pose in rig.poses.items():
        assert np.allclose(again.poses[label].matrix, pose.matrix, atol=1e-12)
        assert (again.poses[label].covariance is None) == (pose.covariance is None)


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({}, "no field `cam0`"),
        ({"cam0": 3}, "`cam0` holds no mapping"),
        ({"cam0": LEFT | {"camera_model": "omni"}}, "`cam0`: its model (omni, radtan) is not pinhole"),
        ({"cam0": LEFT | {"intrinsics": [1, 2, 3]}}, "`cam0`: its intrinsics holds 3 numbers instead of 4"),
        ({"cam0": LEFT | {"resolution": [0, 3]}}, "the image is 0 x 3 px"),
        ({"cam0": LEFT, "cam1": LEFT}, "`cam1`: it has neither `T_cam_imu` nor `T_cn_cnm1`"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, fields, why):
    with pytest.raises(ArtifactError, match=r"cannot be read as a Kalibr camchain") as caught:
        load(tmp_path, fields)
    assert why in caught.value.facts["why"]


CAMERA = Camera(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75)


def test_poses_of_other_frames_are_refused():
    with pytest.raises(ArtifactError, match="every camera needs one pose") as caught:
        Rig(cameras={"left": CAMERA}, poses={"left": Pose(parent="base", child="left", matrix=np.eye(4))})
    assert caught.value.code == "DXB-A513"
    assert caught.value.facts["poses"] == "left: T_base_left"


@pytest.mark.parametrize(
    ("lens", "why"),
    [
        (Equirectangular(width=8, height=4), "no model for equirectangular"),
        (BrownConrady(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75, k3=0.1), "no place for k3"),
    ],
)
def test_what_kalibr_has_no_place_for_is_refused(tmp_path, lens, why):
    rig = Rig(cameras={"left": lens}, poses={"left": Pose(parent="rig", child="left", matrix=np.eye(4))})
    with pytest.raises(ArtifactError, match="cannot be written as a Kalibr camchain") as caught:
        rig.save(tmp_path / "a.yaml")
    assert why in caught.value.facts["why"]
