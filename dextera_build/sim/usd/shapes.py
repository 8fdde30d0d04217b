"""Geometry of a compiled MuJoCo model as USD: primitives are kept, meshes collide as their convex hulls."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.errors import RuleError
from dextera_build.formats.mesh_usd import add_triangles
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import tessellate
from dextera_build.sim.usd.prims import place


def add_shape(stage: Any, path: str, model: Any, geom: int) -> Any:
    """Write a geom in its body's frame and return its prim; the caller adds materials.

    Raises:
        RuleError: USD has no equivalent: a plane or a height field.
    """
    from pxr import Gf

    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    shape = _round(stage, path, model, geom, kind) or _flat(stage, path, model, geom, kind)
    place(shape, transforms.rigid(quaternions.to_matrix(model.geom_quat[geom]), model.geom_pos[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        shape.AddScaleOp().Set(Gf.Vec3f(*model.geom_size[geom].tolist()))
    return shape.GetPrim()


def refused(message: str, hint: str) -> RuleError:
    """The error for a robot that USD cannot represent."""
    return RuleError(f"the robot cannot be written as USD: {message}", code="DXB-B215", hint=hint)


def _round(stage: Any, path: str, model: Any, geom: int, kind: Any) -> Any:
    """A sphere, capsule or cylinder along z; None for anything else."""
    from pxr import Gf, UsdGeom

    radius, half = (float(each) for each in model.geom_size[geom, :2])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        sphere = UsdGeom.Sphere.Define(stage, path)
        sphere.CreateRadiusAttr(radius)
        sphere.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
        return sphere
    kinds = {mujoco.mjtGeom.mjGEOM_CAPSULE: UsdGeom.Capsule, mujoco.mjtGeom.mjGEOM_CYLINDER: UsdGeom.Cylinder}
    if kind not in kinds:
        return None
    shape = kinds[kind].Define(stage, path)
    shape.CreateAxisAttr("Z")
    shape.CreateRadiusAttr(radius)
    shape.CreateHeightAttr(2 * half)
    top = half + (radius if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0)
    shape.CreateExtentAttr([Gf.Vec3f(-radius, -radius, -top), Gf.Vec3f(radius, radius, top)])
    return shape


def _flat(stage: Any, path: str, model: Any, geom: int, kind: Any) -> Any:
    """A cube of edge 2, which the caller scales, or triangles."""
    from pxr import Gf, UsdGeom, UsdPhysics

    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        cube = UsdGeom.Cube.Define(stage, path)
        cube.CreateSizeAttr(2.0)
        cube.CreateExtentAttr([Gf.Vec3f(-1, -1, -1), Gf.Vec3f(1, 1, 1)])
        return cube
    points, faces = tessellate.surface(model, geom)
    if not len(points):
        name = kind.name.removeprefix("mjGEOM_").lower()
        raise refused(f"it has a geometry of type `{name}`", "use boxes, cylinders, capsules or meshes")
    mesh = add_triangles(stage, path, points.astype(np.float32), faces)
    if model.geom_contype[geom] or model.geom_conaffinity[geom]:
        api = UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim())
        api.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    return mesh
