"""twin/tabletop of a stool and of a tray with compartments: the free space of both is free in the simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from dextera_build import Project
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import solids, transforms
from dextera_build.geometry.solids import Solid
from tests import factories, object_views, tabletops

mujoco = pytest.importorskip("mujoco")

EYE = factories.look_at((0.0, -0.7, 0.6), (0.0, 0.0, 0.02))
STOOL, TRAY = factories.pose(-0.2, 0.04, yaw=0.5), factories.pose(0.17, 0.0, yaw=-0.3)
SIZE = np.array([0.26, 0.18, 0.06])
"""Width, depth and height of the tray [m]."""
WALL, BALL = 0.005, 0.012
"""Thickness of the tray's walls, radius of a ball [m]."""
PLACES = {"large": (-0.065, 0.0), "near": (0.065, -0.045), "far": (0.065, 0.045)}
"""Middle of each compartment of the tray (2,) [m]."""


def stool() -> Solid:
    """A plate of 0.2 x 0.16 m, 0.12 m above the table, on four legs."""
    legs = [solids.box((0.016, 0.016, 0.115), (0.085 * x, 0.065 * y, 0.0575)) for x in (-1, 1) for y in (-1, 1)]
    return solids.union([solids.box((0.2, 0.16, 0.014), (0.0, 0.0, 0.113)), *legs])


def tray() -> Solid:
    """A tray with a divider across its middle, and one more in its right half."""
    hole = solids.box(SIZE - [2 * WALL, 2 * WALL, 0.0], (0.0, 0.0, SIZE[2] / 2 + WALL))
    across = solids.box((WALL, SIZE[1], SIZE[2]), (0.0, 0.0, SIZE[2] / 2))
    along = solids.box((SIZE[0] / 2, WALL, SIZE[2]), (SIZE[0] / 4, 0.0, SIZE[2] / 2))
    return solids.union([solids.difference(solids.box(SIZE, (0.0, 0.0, SIZE[2] / 2)), hole), across, along])


def coloured(solid: Solid, colour: tuple[float, float, float]) -> Mesh:
    return object_views.mesh(solid).model_copy(update={"colour": colour})


@dataclass(frozen=True)
class Twin:
    """What the recipe made of the photograph."""

    scene: str
    world: np.ndarray  # T_twin_truth (4, 4)

    def roll(self, place: np.ndarray, velocity: np.ndarray, seconds: float) -> Iterator[np.ndarray]:
        """Positions (3,) of a ball that starts at a place with a velocity, all in the frame of the truth."""
        spec = mujoco.MjSpec.from_file(self.scene)
        ball = spec.worldbody.add_body(name="ball", pos=transforms.apply(self.world, place[None])[0])
        ball.add_freejoint()
        ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], mass=0.01)
        model = spec.compile()
        data = mujoco.MjData(model)
        start = model.jnt_dofadr[model.body("ball").jntadr[0]]
        data.qvel[start : start + 3] = self.world[:3, :3] @ velocity
        back = transforms.invert(self.world)
        for _ in range(round(seconds / model.opt.timestep)):
            mujoco.mj_step(model, data)
            yield transforms.apply(back, data.body("ball").xpos[None])[0]


@pytest.fixture(scope="module")
def twin(tmp_path_factory) -> Twin:
    folder = tmp_path_factory.mktemp("open_bodies")
    things = [(coloured(stool(), (0.75, 0.15, 0.1)), STOOL), (coloured(tray(), (0.2, 0.4, 0.75)), TRAY)]
    tabletops.write(tabletops.tabletop(*things, eye=EYE, lens=tabletops.FINE).capture, folder / "shot")
    (folder / "dxb.toml").write_text("")
    result = Project.find(folder).build("twin/tabletop:scene", inputs={"capture": str(folder / "shot")}, profile="cpu")
    assert result.ok, result.errors
    support: Support = result.artifact("support")
    return Twin(str(result.paths["scene"]), support.camera_pose.matrix @ transforms.invert(EYE))


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_a_ball_that_is_dropped_into_a_compartment_stays_in_it(twin, place):
    start = transforms.apply(TRAY, np.array([[*PLACES[place], SIZE[2] + 0.04]]))[0]
    *_, end = twin.roll(start, np.array([0.1, 0.05, 0.0]), 3.0)
    within = transforms.apply(transforms.invert(TRAY), end[None])[0]
    assert within[2] < 0.5 * SIZE[2], "it lies on the floor of the tray"
    column, row = within[0] > 0, within[1] > 0
    assert (np.abs(within[:2]) < SIZE[:2] / 2).all()
    assert place == ("large" if not column else "far" if row else "near")


@pytest.mark.slow
@pytest.mark.parametrize("along", [0, 1], ids=["along", "across"])
def test_a_ball_rolls_between_the_legs_of_a_stool(twin, along):
    start, velocity = np.zeros(3), np.zeros(3)
    start[along], start[2], velocity[along] = -0.16, BALL + 0.002, 0.8
    place = transforms.apply(STOOL, start[None])[0]
    ways = np.array([*twin.roll(place, STOOL[:3, :3] @ velocity, 0.6)])
    ways = transforms.apply(transforms.invert(STOOL), ways)
    assert ways[-1][along] > 0.12, "it came out on the other side"
    assert np.abs(ways[:, 1 - along]).max() < 0.03
    assert ways[:, 2].max() < 0.03
