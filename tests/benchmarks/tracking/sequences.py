"""Twelve sequences: what moves, what hides it, and where the camera is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from tests.benchmarks.tracking import things
from tests.benchmarks.tracking.scene import Actor, Path, Sequence, before, standing

NAMES = (
    *("cookies", "macaroni_and_cheese", "gelatin_box", "orange_juice", "scanned_wood_block", "black_book"),
    *("red_coffee_mug", "white_yellow_mug", "akita_black_bowl", "can", "duck", "stanfordbunny", "ketchup"),
    *("scanned_power_drill", "piggybank"),
)
ROUND = {"akita_black_bowl", "can"}
"""Objects that are symmetric about an axis, but for a texture."""


def _lifted(x: float, y: float, height: float, turn: np.ndarray) -> np.ndarray:
    return transforms.rigid(np.eye(3), np.array([x, y, height])) @ turn


def _ease(time: float, start: float, end: float) -> float:
    """0 before `start`, 1 after `end`, smooth between."""
    share = float(np.clip((time - start) / (end - start), 0, 1))
    return share * share * (3 - 2 * share)


def _swing(x: float, y: float, height: float, reach: float, period: float, turn_deg: float) -> Path:
    """A thing that is lifted and swung from side to side while it turns."""

    def path(time: float) -> np.ndarray:
        up = _ease(time, 0.2, 0.9)
        phase = 2 * np.pi * max(time - 0.5, 0) / period
        turn = things.turned((0.2, 0.3, 1.0), turn_deg * np.sin(phase) * up)
        return _lifted(x + reach * np.sin(phase) * up, y + 0.3 * reach * np.sin(2 * phase) * up, height * up, turn)

    return path


def _still(x: float, y: float, yaw: float) -> Path:
    return lambda time: standing(x, y, yaw)


def _camera(distance: float = 0.75, pitch: float = 40.0) -> Path:
    return lambda time: before(distance, pitch)


def _sweep(start: tuple[float, float, float], end: tuple[float, float, float], seconds: float) -> Path:
    """A hand that goes to and fro."""

    def path(time: float) -> np.ndarray:
        share = 0.5 - 0.5 * np.cos(2 * np.pi * time / seconds)
        place = (1 - share) * np.array(start) + share * np.array(end)
        return _lifted(*place, things.turned((1, 0, 0), 25.0))

    return path


def _held(time: float) -> np.ndarray:
    return _swing(0.0, 0.0, 0.12, 0.10, 3.0, 25.0)(time)


def _holding(time: float) -> np.ndarray:
    """A hand whose fingers lie across the front of what is held."""
    grip = things.turned((0, 0, 1), 90.0) @ things.turned((0, 1, 0), 20.0)
    return _held(time) @ _lifted(-0.03, -0.05, 0.085, grip)


def _leaving(time: float) -> np.ndarray:
    out = _ease(time, 0.5, 1.3) - _ease(time, 2.2, 3.0)
    turn = things.turned((0, 0, 1), 60.0 * _ease(time, 1.4, 2.1))
    return _lifted(-0.12 + 0.75 * out, 0.0, 0.04 * (out > 0), turn)


def _crossing(side: float, y: float) -> Path:
    def path(time: float) -> np.ndarray:
        share = _ease(time, 0.5, 3.5)
        return _lifted(side * 0.2 * np.cos(np.pi * share), y, 0.03, things.turned((0, 0, 1), side * 40 * share))

    return path


def _lid(time: float) -> np.ndarray:
    return np.array([np.radians(100) * (_ease(time, 0.4, 1.8) - 0.6 * _ease(time, 2.0, 3.4))])


def _orbit(time: float) -> np.ndarray:
    return before(0.75 - 0.1 * np.sin(time), 40 + 8 * np.sin(1.3 * time), 28 * np.sin(0.9 * time))


def every(meshes: Mapping[str, Mesh]) -> list[Sequence]:
    """All sequences of the benchmark."""
    links, joints = things.chest()
    hand = things.hand()

    def made(name: str, paths: Mapping[str, Path], camera: Path | None = None, seconds: float = 4.0) -> Sequence:
        actors = {each: Actor({"base": meshes[each]}, path, symmetric=each in ROUND) for each, path in paths.items()}
        return Sequence(name, actors, camera or _camera(), seconds)

    def with_hand(sequence: Sequence, path: Path) -> Sequence:
        actors = {**sequence.actors, "hand": Actor({"base": hand}, path, tracked=False)}
        return replace(sequence, actors=actors)

    standing_still = {
        "gelatin_box": _still(-0.1, 0.0, 20),
        "white_yellow_mug": _still(0.1, 0.0, -30),
    }
    before_camera = {
        "cookies": _still(-0.2, 0.0, 15),
        "red_coffee_mug": _still(0.0, 0.12, 60),
        "akita_black_bowl": _still(0.02, -0.06, 0),
        "scanned_power_drill": _still(0.2, 0.05, -40),
    }
    resting = {
        "black_book": _still(-0.2, 0.0, 15),
        "white_yellow_mug": _still(0.0, 0.12, 60),
        "can": _still(0.05, -0.06, 0),
        "duck": _still(0.2, 0.05, -40),
    }
    left, right = (-0.12, 0.0), (0.14, 0.0)
    chest = Actor(links, _swing(0.0, 0.05, 0.0, 0.03, 4.0, 12.0), joints, _lid)
    return [
        made(
            "slow",
            {
                "macaroni_and_cheese": _swing(*left, 0.08, 0.06, 4.0, 20.0),
                "red_coffee_mug": _swing(*right, 0.06, 0.05, 4.0, 30.0),
            },
        ),
        made(
            "slow_plain",
            {
                "duck": _swing(*left, 0.06, 0.05, 4.0, 30.0),
                "stanfordbunny": _swing(*right, 0.06, 0.05, 4.0, 30.0),
            },
        ),
        made(
            "round",
            {
                "akita_black_bowl": _swing(*left, 0.06, 0.06, 4.0, 10.0),
                "can": _swing(*right, 0.08, 0.06, 3.0, 15.0),
            },
        ),
        made("fast", {"cookies": _swing(0.0, 0.0, 0.10, 0.16, 1.6, 60.0)}),
        made("fast_plain", {"piggybank": _swing(0.0, 0.0, 0.08, 0.14, 1.6, 40.0)}),
        with_hand(made("hand_over_still", standing_still), _sweep((-0.3, 0.12, 0.12), (0.3, -0.06, 0.12), 4.0)),
        with_hand(made("held", {"orange_juice": _held}), _holding),
        made("leaving", {"scanned_wood_block": _leaving, "ketchup": _still(0.1, 0.15, 0)}, seconds=4.5),
        Sequence("lid", {"chest": chest}, _camera(), 4.0),
        made("crossing", {"can": _crossing(-1.0, 0.10), "macaroni_and_cheese": _crossing(1.0, -0.05)}),
        made("camera", before_camera, _orbit, 5.0),
        replace(made("rest", resting, seconds=60.0), rate=5.0),
    ]
