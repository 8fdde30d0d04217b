"""The backend `hunyuan3d_cloud`, through the vendor's SDK, against a local server that checks its signatures."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image

from dextera_build import redact
from dextera_build.artifacts.objects.object import Body, Link
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.calls.recorder import Recorder
from dextera_build.calls.terms import Terms, written
from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.formats import mesh as mesh_files
from dextera_build.geometry import solids, transforms
from dextera_build.store.store import Store
from dextera_build.testing import RuleRunner
from tests import object_views
from tests.installed import needs
from tests.rules.factorize.shapes.tencent import SECRET_ID, SECRET_KEY, serving_tencent

needs("tencentcloud.ai3d")
SCALE, SHIFT = 7.0, np.array([0.3, -0.2, 0.5])


def glb(solid, folder) -> bytes:
    """The solid as a generator would return it: in another unit, elsewhere, with a texture."""
    vertices = SCALE * solid.vertices + SHIFT
    uv = np.random.default_rng(0).random((len(solid.faces), 3, 2))
    picture = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)
    made = Mesh(
        vertices=vertices.astype(np.float32),
        faces=solid.faces.astype(np.int32),
        uv=uv.astype(np.float32),
        texture=object_views.Image(pixels=picture),
    )
    mesh_files.save(made, folder / "made.glb")
    return (folder / "made.glb").read_bytes()


@pytest.fixture(scope="module")
def mug():
    return object_views.view(object_views.mesh(object_views.mug()), transforms.rigid(np.eye(3), np.zeros(3)))


@pytest.fixture
def service(tmp_path, monkeypatch):
    monkeypatch.setattr(redact, "_values", {})
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    with serving_tencent(glb(object_views.mug(), tmp_path)) as made:
        monkeypatch.setenv("DXB_HUNYUAN_URL", made.url)
        monkeypatch.setenv("TENCENTCLOUD_SECRET_ID", SECRET_ID)
        monkeypatch.setenv("TENCENTCLOUD_SECRET_KEY", SECRET_KEY)
        yield made


@pytest.fixture
def complete(tmp_path, mug):
    def run(mode="record", terms=None, view=None, **options):
        runner = RuleRunner(tmp_path, calls=Recorder(Store(tmp_path / "store"), mode, terms=terms))
        shape = runner.run(
            "factorize.mesh",
            backend="hunyuan3d_cloud",
            options={"hunyuan3d_cloud": options},
            **object_views.sights(view or mug),
        )
        run.line = runner.outcome.line
        return shape

    return run


@pytest.mark.medium
def test_a_mesh_comes_from_the_photograph_alone(complete, service, mug):
    shape = complete()
    assert shape.asset_source == "rgb"
    assert shape.pose is None
    assert shape.residual_m is None
    assert shape.mesh.is_closed
    assert shape.hollow
    assert shape.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    extent = np.ptp(object_views.mug().vertices, axis=0)
    assert shape.mesh.extent == pytest.approx(SCALE * extent, rel=1e-4)
    # The outline of the right thing, seen from somewhere above, is that of the photograph.
    assert shape.mask_iou > 0.9
    assert 0.4 < shape.unseen_fraction < 0.9
    assert shape.hypothesis == "hunyuan3d 3.1"
    assert "hunyuan3d 3.1, hollow" in complete.line
    assert shape.mesh.texture is not None
    (told,) = service.submitted
    assert {name: told[name] for name in told if name != "ImageBase64"} == {
        "Model": "3.1",
        "GenerateType": "Normal",
        "EnablePBR": False,
        "FaceCount": 40_000,
    }
    assert service.region == "ap-guangzhou"
    assert service.seen == ["Submit", "Query", "Query", "Query", "Query", "File"]


@pytest.mark.medium
def test_the_picture_shows_the_object_on_white_and_nothing_else(complete, service, mug):
    complete()
    sent = np.asarray(Image.open(io.BytesIO(service.picture())))
    assert sent.shape[0] == sent.shape[1]
    assert 128 <= sent.shape[0] <= 5000
    assert len(service.picture()) <= 6 << 20
    assert (sent[:3] == 255).all()
    coloured = (sent < 250).any(axis=-1)
    rows, columns = np.flatnonzero(coloured.any(axis=1)), np.flatnonzero(coloured.any(axis=0))
    height, width = np.ptp(np.flatnonzero(mug.view.mask.any(axis=1))), np.ptp(np.flatnonzero(mug.view.mask.any(axis=0)))
    assert np.ptp(rows) / np.ptp(columns) == pytest.approx(height / width, rel=0.05)
    assert (rows[0] + rows[-1]) / 2 == pytest.approx(sent.shape[0] / 2, abs=4)


@pytest.mark.medium
def test_the_answer_is_replayed_without_service_and_secrets(complete, service, monkeypatch):
    first = complete()
    for name in ("DXB_HUNYUAN_URL", "TENCENTCLOUD_SECRET_ID", "TENCENTCLOUD_SECRET_KEY"):
        monkeypatch.delenv(name)
    seen = len(service.seen)
    again = complete("replay")
    assert np.array_equal(again.mesh.vertices, first.mesh.vertices)
    assert len(service.seen) == seen


@pytest.mark.medium
def test_options_reach_the_service(complete, service):
    complete(model="3.0", kind="Geometry", faces=None, pbr=True)
    (told,) = service.submitted
    assert (told["Model"], told["GenerateType"], told["EnablePBR"]) == ("3.0", "Geometry", True)
    assert "FaceCount" not in told


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        {"Submit": ["RequestLimitExceeded.JobNumExceed", "InternalError", "502"]},
        {"Query": ["cut", "html", "torn"]},
        {"File": ["502", "torn", "cut"]},
    ],
)
def test_faults_of_service_and_network_are_waited_out(complete, service, faults):
    service.faults = faults
    assert complete().mesh.is_closed
    assert len(service.submitted) <= 2  # 502 tells nothing of whether the job was taken


@pytest.mark.parametrize(
    ("setup", "code", "message"),
    [
        ({"fails": "nothing to see"}, "DXB-B360", "failed: FailedOperation nothing to see"),
        ({"types": ["OBJ", "STL"]}, "DXB-B344", "made no GLB, only: OBJ, STL"),
        ({"glb": b"PK\3\4 a zip"}, "DXB-B345", "the file is not a binary glTF 2.0"),
        ({"glb": b"glTF\2\0\0\0\xff\0\0\0"}, "DXB-B345", "the file has 12 bytes, but its header states 255"),
        ({"faults": {"Submit": ["FailedOperation.NoQuota"]}}, "DXB-B344", "it answered 400"),
        ({"faults": {"Submit": ["UnauthorizedOperation"]}}, "DXB-E361", "denies access"),
        ({"faults": {"Query": ["InternalError"] * 9}}, "DXB-E360", "cannot be reached: it answered 503"),
    ],
)
def test_what_cannot_be_mended_is_one_clear_error(complete, service, setup, code, message):
    for name, value in setup.items():
        setattr(service, name, value)
    with pytest.raises(DxbError, match=message) as caught:
        complete()
    assert caught.value.code == code
    assert SECRET_KEY not in json.dumps(caught.value.to_json())


@pytest.mark.parametrize("content_type", ["application/json", "application/json; charset=utf-8"])
def test_what_the_service_said_is_told(complete, service, content_type):
    service.content_type = content_type
    service.faults = {"Submit": ["FailedOperation.NoQuota"]}
    with pytest.raises(RuleError) as caught:
        complete()
    assert "FailedOperation.NoQuota" in caught.value.facts["it said"]


@pytest.mark.parametrize("name", ["TENCENTCLOUD_SECRET_ID", "TENCENTCLOUD_SECRET_KEY"])
def test_a_wrong_or_missing_secret(complete, service, monkeypatch, name):
    monkeypatch.setenv(name, "wrong-0123456789")
    with pytest.raises(MachineError, match="denies access") as caught:
        complete()
    assert caught.value.code == "DXB-E361"
    monkeypatch.delenv(name)
    with pytest.raises(MachineError, match=f"there is no secret `{name}`"):
        complete()
    assert service.submitted == []


@pytest.mark.slow
def test_a_job_of_an_earlier_build_is_waited_for(complete, service):
    service.faults = {"Query": ["InternalError"] * 4}
    with pytest.raises(MachineError):
        complete()
    assert complete().mesh.is_closed
    assert len(service.submitted) == 1


@pytest.mark.slow
def test_a_job_that_expired_is_submitted_again(complete, service):
    service.faults = {"Query": ["InternalError"] * 4}
    with pytest.raises(MachineError):
        complete()
    service.jobs.clear()
    assert complete().mesh.is_closed
    assert len(service.submitted) == 2


def test_pictures_do_not_leave_in_the_clear_or_without_consent(complete, service, monkeypatch):
    with pytest.raises(MachineError, match="`hunyuan3d` would receive a photograph"):
        complete(terms=Terms.read(written({}, None, "", [])))
    monkeypatch.setenv("DXB_HUNYUAN_URL", "http://192.0.2.1")
    with pytest.raises(MachineError, match="would be sent in the clear") as caught:
        complete()
    assert caught.value.code == "DXB-E363"
    assert service.seen == []


def test_a_mesh_that_cannot_be_closed_is_refused(complete, service, tmp_path):
    box = solids.box((0.1, 0.1, 0.1), (0.0, 0.0, 0.05))
    three = np.concatenate([box.faces, [[0, 1, 7], [0, 2, 7], [0, 3, 7], [0, 7, 5]]])
    service.glb = glb(solids.Solid(box.vertices, three), tmp_path)
    with pytest.raises(RuleError, match=r"cannot be closed|the mesh is open"):
        complete()


def test_an_empty_mask_is_refused(complete, service, mug):
    empty = object_views.changed(mug, mask=np.zeros_like(mug.view.mask))
    with pytest.raises(RuleError, match="the mask is empty"):
        complete(view=empty)
    assert service.seen == []


@pytest.mark.slow
def test_the_measurements_find_its_scale_and_place(complete, service, mug, tmp_path):
    shape = complete()
    body = Body(links={"base": Link(mesh=shape.mesh)}, hollow=shape.hollow, asset_source=shape.asset_source)
    placed = RuleRunner(tmp_path).run("align.object", backend="icp", body=body, **object_views.sights(mug))
    assert placed.scale == pytest.approx(1.0 / SCALE, rel=0.03)
    assert placed.residual_m < 0.003
    assert placed.asset_source == "rgb"
    # The mug stands in the origin of the world, on the table; its handle shifts the middle of its extent.
    vertices = object_views.mug().vertices
    middle = (vertices[:, :2].min(axis=0) + vertices[:, :2].max(axis=0)) / 2
    assert placed.pose.matrix[:3, 3] == pytest.approx([*middle, 0.0], abs=0.006)
