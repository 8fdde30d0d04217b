"""Opens a URDF with Pinocchio, in a process of its own: `pinocchio_reader.py FILE.urdf POSITIONS.json OUT.npz`.

`POSITIONS.json` is a list of states, each joint -> position [rad or m]; joints that follow another one are left out.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pinocchio


def main(file: str, positions: str, out: str) -> None:
    """Write joints, limits, poses of links in the root and mass matrices at every state, and the numbers of shapes."""
    model = pinocchio.buildModelFromUrdf(file, mimic=True)
    data = model.createData()
    folder = str(Path(file).parent)
    kinds = {"collision": pinocchio.GeometryType.COLLISION, "visual": pinocchio.GeometryType.VISUAL}
    shapes = {name: pinocchio.buildGeomFromUrdf(model, file, kind, folder) for name, kind in kinds.items()}
    joints = [name for name in list(model.names)[1:] if model.joints[model.getJointId(name)].nq]
    links = [frame for frame in model.frames if frame.type == pinocchio.FrameType.BODY]
    at = [model.joints[model.getJointId(name)].idx_q for name in joints]
    poses, matrices = [], []
    for state in json.loads(Path(positions).read_text()):
        q = pinocchio.neutral(model)
        q[at] = [state[name] for name in joints]
        pinocchio.framesForwardKinematics(model, data, q)
        upper = np.triu(pinocchio.crba(model, data, q))
        matrices.append((upper + np.triu(upper, 1).T)[np.ix_(at, at)])
        poses.append([data.oMf[model.getFrameId(link.name)].homogeneous for link in links])
    np.savez(
        out,
        joints=joints,
        every_joint=list(model.names)[1:],
        lower=model.lowerPositionLimit[at],
        upper=model.upperPositionLimit[at],
        effort=model.upperEffortLimit[at],
        velocity=model.upperVelocityLimit[at],
        links=[link.name for link in links],
        fixed_kg=model.inertias[0].mass,
        moving_kg=sum(inertia.mass for inertia in list(model.inertias)[1:]),
        poses=poses,
        matrices=matrices,
        **{name: len(shape.geometryObjects) for name, shape in shapes.items()},
    )


main(*sys.argv[1:])
