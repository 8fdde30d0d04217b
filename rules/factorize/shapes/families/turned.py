"""A family of standing bodies in another pose: vessels that lie or lean, with their opening towards the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms

from ..evidence import Evidence
from ..refine import Model

LEAST_RAD = 0.25
"""Minimum angle between the axis and the vertical; vessels nearer to it are fitted standing."""
ALIKE_RAD = 0.3
"""Axes closer together than this angle are merged [rad]."""
OWN = 3
"""Number of additional parameters, which precede those of the standing body."""


@dataclass(frozen=True)
class Turned:
    """The view in a world in which the body stands, and a model there, expressed in the original world."""

    evidence: Evidence
    world_from_turned: np.ndarray  # (4, 4)

    def pose(self, p: np.ndarray) -> np.ndarray:
        """T_world_standing (4, 4): two small turns [rad] and the height of the base [m] correct the first guess."""
        turn = lie.rotation(np.array([p[0], p[1], 0.0]))
        return np.asarray(self.world_from_turned @ transforms.rigid(turn, np.array([0.0, 0.0, p[2]])))

    def model(self, standing: Model, name: str, cost: float) -> Model:
        """`standing`, fitted in the turned world, with the parameters of `pose` before its own."""
        count = len(standing.steps)
        smooth = standing.smooth
        return Model(
            name=name,
            build=lambda p: standing.build(p[OWN:]).moved(self.pose(p)),
            starts=[np.concatenate([np.zeros(OWN), start]) for start in standing.starts],
            steps=np.concatenate([[0.02, 0.02, 0.003], standing.steps]),
            lower=np.concatenate([[-0.8, -0.8, -0.2], standing.lower]),
            upper=np.concatenate([[0.8, 0.8, 0.2], standing.upper]),
            expected=None if standing.expected is None else np.concatenate([np.zeros(OWN), standing.expected]),
            spread=np.concatenate([np.full(OWN, np.inf), np.broadcast_to(standing.spread, count)]),
            smooth=None if smooth is None else np.pad(smooth, ((0, 0), (OWN, 0))),
            cost=standing.cost + cost,
        )


def turned(evidence: Evidence) -> list[Turned]:
    """Worlds in which a lying or leaning vessel stands, its opening up: one for each likely axis."""
    return [_about(evidence, axis) for axis in _axes(evidence)]


def _axes(evidence: Evidence) -> list[np.ndarray]:
    """Unit directions (3,) towards the camera: of a cylinder's axis, and of the mean normal of the seen points."""
    normals = evidence.normals
    across = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    towards = evidence.eye - np.median(evidence.points, axis=0)
    found: list[np.ndarray] = []
    for axis in (across, normals.mean(axis=0)):
        unit = axis / max(float(np.linalg.norm(axis)), 1e-9)
        unit = unit if unit @ towards > 0 else -unit
        if np.arccos(np.clip(unit[2], -1.0, 1.0)) < LEAST_RAD:
            continue
        if all(np.arccos(np.clip(unit @ other, -1.0, 1.0)) > ALIKE_RAD for other in found):
            found.append(unit)
    return found


def _about(evidence: Evidence, axis: np.ndarray) -> Turned:
    side = np.cross([0.0, 0.0, 1.0], axis)
    x = side / np.linalg.norm(side)
    rotation = np.stack([x, np.cross(axis, x), axis], axis=-1)
    low = float(np.quantile(evidence.points @ axis, 0.01))
    world_from_turned = transforms.rigid(rotation, axis * low)
    back = transforms.invert(world_from_turned)
    return Turned(_turned(evidence, back, rotation), world_from_turned)


def _turned(evidence: Evidence, back: np.ndarray, rotation: np.ndarray) -> Evidence:
    """The evidence after the motion `back` (4, 4) with the inverse of `rotation` (3, 3); rays, for fits, stay."""
    return replace(
        evidence,
        world_from_camera=back @ evidence.world_from_camera,
        points=transforms.apply(back, evidence.points),
        normals=evidence.normals @ rotation,
        others=tuple(_turned(other, back, rotation) for other in evidence.others),
    )
