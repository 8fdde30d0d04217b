"""Options of the errors of an RGB-D camera, simulated by `dextera_build.sim.render.sensor`."""

from __future__ import annotations

from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.rule import Options


class DepthNoiseOptions(DepthNoise, Options):
    """Noise of the depth stream."""


class ColourNoiseOptions(ColourNoise, Options):
    """Noise of the colour stream."""
