"""Vessels from one photograph to the simulator: an open cavity, a ball that stays, the mass of the walls."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Body, Collision, Link, Shape
from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid
from dextera_build.sim.model import model, names
from dextera_build.testing import RuleRunner
from rules.factorize import manifolds
from tests import factories, object_views, twins
from tests.benchmarks import catalogue
from tests.rules.factorize import synthetic_views as synthetic
from tests.rules.factorize.contact.test_collision import rests_at

BALL_M = 0.012


def basket() -> Solid:
    """A rectangular vessel, 24 x 16 x 10 cm."""
    rings = []
    for z, inset in ((0.0, 0.02), (0.1, 0.0), (0.1, 0.004), (0.005, 0.023)):
        a, b = 0.12 - inset, 0.08 - inset
        rings.append(np.array([[a, b, z], [-a, b, z], [-a, -b, z], [a, -b, z]]))
    return solids.loft(np.stack(rings))


def foreign(name: str, folder: Path) -> Solid:
    """A mesh that others made, as it stands."""
    if not (catalogue.FOLDER / ".fetched").exists():
        pytest.skip(f"no mesh `{name}`: `make meshes`")
    entries = {name: catalogue.entries()[name]}
    paths = [path for part in entries[name]["parts"] for path in (part["file"], part.get("texture")) if path]
    files = Folder(files={path: (catalogue.FOLDER / path).read_bytes() for path in paths})
    read = RuleRunner(folder).run("reference.catalogue", folder=files, options={"entries": entries}).items[name]
    return Solid(read.surface.vertices.astype(np.float64), read.surface.faces.astype(np.int64))


def photographed(standing: Solid, folder: Path, family: str) -> tuple[Shape, Collision]:
    """Shape and collision pieces from one noisy view of the vessel."""
    runner = RuleRunner(folder)
    seen = synthetic.view(synthetic.placed(standing, 0.01, 0.02, 20), synthetic.fine(distance=0.7, pitch_deg=45))
    options = {"primitives": {"hypotheses": (family, "mirrored")}}
    shape = runner.run("factorize.mesh", options=options, **object_views.sights(seen))
    body = Body(links={"base": Link(mesh=shape.mesh, walls=shape.walls)}, pose=shape.pose, hollow=shape.hollow)
    return shape, runner.run("factorize.collision", body=body)


def holds_a_ball(standing: Solid, folder: Path, family: str) -> None:
    shape, collision = photographed(standing, folder, family)
    assert (shape.hypothesis, shape.hollow) == (family, True)
    made = collision.links["base"]
    assert made.cavity_fill is not None
    assert made.cavity_fill < 0.05
    assert made.excess is not None
    assert made.excess < 0.15, "of the volume of thin walls"
    height = float(shape.mesh.vertices[:, 2].max())
    rest = rests_at(made.hulls, BALL_M, above=height + 0.05)
    assert BALL_M < rest < height - BALL_M / 2, "it lies inside, below the rim"


@pytest.mark.slow
@pytest.mark.parametrize("family", ["open_box", "revolved_hollow"])
def test_a_ball_stays_in_a_vessel_made_from_a_photograph(tmp_path, family):
    vessel = basket() if family == "open_box" else synthetic.bowl(0.08, 0.035, 0.055, 0.004)
    holds_a_ball(vessel, tmp_path, family)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "family"), [("basket", "open_box"), ("white_bowl", "revolved_hollow")])
def test_a_ball_stays_in_a_vessel_that_others_made(tmp_path, name, family):
    holds_a_ball(foreign(name, tmp_path), tmp_path, family)


@pytest.mark.medium
@pytest.mark.parametrize("name", ["bowl", "mug", "basket"])
def test_compiled_mass_and_inertia_are_volume_times_density(tmp_path, name):
    mesh = object_views.mesh(basket() if name == "basket" else getattr(object_views, name)())
    body = object_views.body(mesh, hollow=True)
    seen = object_views.view(mesh, np.eye(4), material="ceramic")
    physics = RuleRunner(tmp_path).run("factorize.physics", body=body, traits=seen.traits)
    asset = factories.bowl_asset().model_copy(update={"body": body, "physics": physics})
    scene = twins.scene({"vessel": asset})
    loaded = model.compile_folder(scene)
    compiled = loaded.body(names.link_names({"vessel": asset})["vessel", "base"])
    density = 2300.0
    mass = density * manifolds.solid(mesh).volume()
    assert compiled.mass[0] == pytest.approx(mass, rel=0.01)
    moments = np.sort(density * _moments(mesh.vertices.astype(np.float64), mesh.faces))
    assert np.sort(compiled.inertia) == pytest.approx(moments, rel=0.01)
    # MuJoCo's own estimate for such a mesh is that of a filled body.
    assert _naive_mass(mesh.vertices, mesh.faces, density) > 2.0 * mass


def _moments(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Principal moments (3,) at density 1 by sampling: independent of the rule's own integrals."""
    from dextera_build.geometry import raycast

    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cells = np.array([160, 160, 400])
    columns = np.stack(np.meshgrid(*[np.arange(n) for n in cells[:2]], indexing="ij"), -1).reshape(-1, 2)
    step = (high - low) / cells
    start = np.column_stack([low[:2] + (columns + 0.5) * step[:2], np.full(len(columns), low[2] - 0.01)])
    inside = np.zeros((len(columns), cells[2]), bool)
    heights = low[2] + (np.arange(cells[2]) + 0.5) * step[2]
    surface, at = raycast.Surface(vertices, faces), start.copy()
    for _ in range(12):
        hit = raycast.cast([surface], np.c_[at, np.tile([0.0, 0.0, 1.0], (len(at), 1))])
        met = hit.index >= 0
        if not met.any():
            break
        z = np.where(met, at[:, 2] + hit.depth, np.inf)
        inside ^= heights[None] > z[:, None]
        at[:, 2] = np.where(met, z + 1e-6, 1e3)
    points = np.concatenate(
        [np.repeat(start[:, None, :2], cells[2], axis=1), np.broadcast_to(heights[None, :, None], (*inside.shape, 1))],
        axis=-1,
    )[inside]
    centred = points - points.mean(axis=0)
    covariance = centred.T @ centred * step.prod()
    return np.linalg.eigvalsh(np.trace(covariance) * np.eye(3) - covariance)


def _naive_mass(vertices: np.ndarray, faces: np.ndarray, density: float) -> float:
    """Mass [kg] that MuJoCo's default inertia gives the mesh as one geom."""
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="vessel", uservert=vertices.ravel(), userface=faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_LEGACY
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="vessel", density=density)
    return float(spec.compile().body_mass[1])
