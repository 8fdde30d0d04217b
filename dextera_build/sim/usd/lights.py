"""Lights of a scene as UsdLux: its own as distant lights, MuJoCo's headlight as a dome.

    /World/Lights               scope
      <light>                   a `DistantLight` for each light of the scene
      sky                       a `DomeLight` of one colour, from which every surface gets the rest

A white level surface without shadows has the given luminance. The closed room around a twin casts no shadows, by the
lights' collection `shadowLink`; otherwise it would be dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.scenes.scene_description import Light
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.model import mjcf

ANGLE_DEG = 5.0
"""Angular diameter of a light, which softens the edges of its shadows as lamps of rooms do [degrees]."""


def add_lights(stage: Any, path: str, lights: Sequence[Light], white_nits: float, room: str) -> None:
    """Add a scope `path` with the lights of a scene.

    Args:
        stage: The stage.
        path: Path of the scope.
        lights: Lights of the scene, in the world frame.
        white_nits: Luminance of a white level surface that sees all lights [cd/m^2].
        room: Path of the prims that cast no shadows.
    """
    from pxr import UsdGeom, UsdLux

    UsdGeom.Scope.Define(stage, path)
    sky = white_nits * np.ones(3)
    for light in lights:
        luminance = white_nits * np.asarray(light.diffuse) / mjcf.LIGHTS
        direction = np.asarray(light.direction) / np.linalg.norm(light.direction)
        # A level Lambertian surface of albedo 1 has the luminance E cos(angle) / pi.
        _distant(stage, f"{path}/{light.label}", direction, np.pi * luminance, room)
        sky = sky - luminance * max(0.0, -direction[2])
    dome = UsdLux.DomeLight.Define(stage, f"{path}/sky")
    _shine(dome, np.maximum(sky, 0.0), room)


def _distant(stage: Any, path: str, direction: np.ndarray, lux: np.ndarray, room: str) -> None:
    """Add a light along `direction` (3,) with the illuminance `lux` (3,) on a surface that faces it."""
    from pxr import Gf, UsdGeom, UsdLux

    light = UsdLux.DistantLight.Define(stage, path)
    turn = quaternions.from_matrix(transforms.rotation_between(np.array([0.0, 0.0, -1.0]), direction))
    light.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(*turn.tolist()))
    light.CreateAngleAttr(ANGLE_DEG)
    # Normalized, the intensity is the illuminance, whatever the angle.
    light.CreateNormalizeAttr(True)
    _shine(light, lux, room)


def _shine(light: Any, strength: np.ndarray, room: str) -> None:
    from pxr import Gf, Sdf, UsdLux

    brightest = float(strength.max())
    light.CreateIntensityAttr(brightest)
    light.CreateColorAttr(Gf.Vec3f(*(strength / brightest if brightest else np.ones(3)).tolist()))
    UsdLux.LightAPI(light).GetShadowLinkCollectionAPI().CreateExcludesRel().AddTarget(Sdf.Path(room))
