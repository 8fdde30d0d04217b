"""Random values of cameras and of what they see, whose fields depend on one another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st
from pydantic import BaseModel

from dextera_build.artifacts.lens import BrownConrady, DepthNoise, Equirectangular, KannalaBrandt

Draw = Callable[[st.SearchStrategy[Any]], Any]
SIZES = st.integers(1, 12)
LENGTHS = st.floats(1, 1e4)
COEFFICIENTS = st.floats(-1, 1)


def _size(draw: Draw) -> dict[str, Any]:
    return {"width": draw(SIZES), "height": draw(SIZES)}


def _lens(draw: Draw, *names: str) -> dict[str, Any]:
    base = {name: draw(LENGTHS) for name in ("fx", "fy", "cx", "cy")}
    return _size(draw) | base | {name: draw(COEFFICIENTS) for name in names}


def _brown_conrady(draw: Draw) -> dict[str, Any]:
    return _lens(draw, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def _kannala_brandt(draw: Draw) -> dict[str, Any]:
    return _lens(draw, "k1", "k2", "k3", "k4")


def _depth_noise(draw: Draw) -> dict[str, Any]:
    return {name: draw(st.floats(0.01, 1)) for name in DepthNoise.model_fields}


SPECIAL: dict[type[BaseModel], Callable[[Draw], dict[str, Any]]] = {
    BrownConrady: _brown_conrady,
    KannalaBrandt: _kannala_brandt,
    Equirectangular: _size,
    DepthNoise: _depth_noise,
}
