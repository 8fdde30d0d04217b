"""Random values of cameras and of what they see, whose fields depend on one another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st
from pydantic import BaseModel

from dextera_build.artifacts.lens import BrownConrady, DepthNoise, Equirectangular, KannalaBrandt
from dextera_build.artifacts.track import Track
from dextera_build.artifacts.trajectory import Trajectory

Draw = Callable[[st.SearchStrategy[Any]], Any]
FRAMES = st.from_regex(r"[a-z][a-z0-9_]{0,7}", fullmatch=True)
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


def series(draw: Draw) -> dict[str, Any]:
    """Frames, increasing stamps, poses and covariances or None."""
    count = draw(st.integers(1, 5))
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    poses = random.normal(size=(count, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    spread = random.normal(size=(count, 6, 6))
    return {
        "parent": draw(FRAMES),
        "child": draw(FRAMES),
        "stamps": np.cumsum(random.uniform(0.01, 1, count)),
        "poses": poses,
        "covariances": spread @ spread.transpose(0, 2, 1) if draw(st.booleans()) else None,
    }


def _track(draw: Draw) -> dict[str, Any]:
    fields = series(draw)
    kinds = st.sampled_from(["tracked", "predicted", "lost"])
    status = tuple(draw(kinds) for _ in fields["stamps"])
    fields["poses"][[word == "lost" for word in status]] = np.nan
    return fields | {"status": status}


SPECIAL: dict[type[BaseModel], Callable[[Draw], dict[str, Any]]] = {
    BrownConrady: _brown_conrady,
    KannalaBrandt: _kannala_brandt,
    Equirectangular: _size,
    DepthNoise: _depth_noise,
    Trajectory: series,
    Track: _track,
}
