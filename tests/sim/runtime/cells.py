"""The gate of `tests.gate` as a tracker knows it, and a cell that watches it."""

from __future__ import annotations

from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset, Body, Collision, Joint, Link, Pieces
from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from tests import factories, gate

CASE = ((-0.04, -0.04, -0.05), (0.04, 0.04, 0.05))
FLAP = ((0.0, -0.005, 0.053), (0.2, 0.005, 0.077))
CAMERA = Camera(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
EYE = factories.look_at((0.25, -0.55, 0.6), (0.05, 0.0, 0.05))
"""T_world_camera: the peg does not hide the flap from there."""


def asset() -> Asset:
    """The case with its flap, where `gate.bundle` has it."""
    joint = Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="flap",
        origin=(0.0, 0.0, 0.065),
        axis=(0.0, 0.0, 1.0),
        lower=-2.0,
        upper=2.0,
        position=0.0,
    )
    links = {
        "base": Link(mesh=factories.box_mesh(*CASE, colour=(0.2, 0.3, 0.7))),
        "flap": Link(mesh=factories.box_mesh(*FLAP, colour=(0.9, 0.7, 0.1))),
    }
    place = factories.placed(factories.pose(z=0.05))
    return Asset(
        body=Body(links=links, joints=(joint,), pose=place),
        physics=factories.physics({"base": factories.box_inertial(*CASE, 8.0)}),
        collision=Collision(
            links={
                name: Pieces(hulls=(Hull(vertices=link.mesh.vertices),), method="hull") for name, link in links.items()
            }
        ),
        pose=place,
        category="case",
    )


def cell(error: np.ndarray | None = None, **changed: Any) -> Cell:
    """A cell at 20 Hz without delay, loss and noise.

    Args:
        error: (4, 4), T_calibrated_true of the camera; None: the calibration is exact.
        changed: Other fields.
    """
    base = transforms.invert(gate.WORLD_FROM_BASE) @ EYE
    mount = transforms.invert(base if error is None else base @ transforms.invert(error))
    quiet = DepthNoise(subpixel_px=0.0, edge_loss=0.0, dropout=0.0, grazing_deg=90.0)
    fields: dict[str, Any] = {
        "assets": {"case": asset()},
        "camera": CAMERA,
        "mount": Pose(parent="camera", child="base", matrix=mount),
        "eye": Pose(parent="base", child="camera", matrix=base),
        "rate_hz": 20.0,
        "delay_s": 0.0,
        "loss": 0.0,
        "search_s": 1.0,
        "depth_noise": quiet,
        "colour_noise": ColourNoise(sigma=0.0, vignetting=0.0),
    }
    return Cell(**(fields | changed))
