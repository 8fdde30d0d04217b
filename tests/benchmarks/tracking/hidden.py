"""Sequences in which objects are half hidden for long: by a hand, by another thing, and by the border."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import transforms
from tests.benchmarks.tracking import things
from tests.benchmarks.tracking.scene import Actor, Path, Sequence, before, standing

SECONDS = 4.0
FAR = np.array([0.6, -0.2, 0.2])
"""Where what hides something waits, outside the picture."""
BESIDE = np.array([0.2, -0.05, 0.0])
"""Where a thing stands before it hides another one."""
SWAY = 0.007
"""By how much what hides something moves [m]."""


def ease(time: float, start: float, end: float) -> float:
    """0 before `start`, 1 after `end`, smooth between."""
    share = float(np.clip((time - start) / (end - start), 0, 1))
    return share * share * (3 - 2 * share)


def _placed(at: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return transforms.rigid(np.eye(3), at) @ turn


def _comes(there: tuple[float, float, float], turn: np.ndarray, start: np.ndarray = FAR) -> Path:
    """Comes from the right, stays before something with small motions, and leaves."""

    def path(time: float) -> np.ndarray:
        near = ease(time, 0.2, 0.8) - ease(time, 3.6, 4.0)
        moving = SWAY * np.array([np.sin(2.1 * time), 0.3 * np.sin(1.3 * time), 0.5 * np.sin(1.7 * time)])
        return _placed((1 - near) * start + near * (np.array(there) + moving), turn)

    return path


def _carried(x: float, y: float, height: float, turn_deg: float) -> Path:
    """Lifted, and moved slowly to and fro while it turns."""

    def path(time: float) -> np.ndarray:
        up = ease(time, 0.8, 1.4)
        swing = np.sin(2 * np.pi * max(time - 1.0, 0) / 3.0) * up
        return _placed(
            np.array([x + 0.05 * swing, y + 0.02 * swing, height * up]),
            things.turned((0.1, 0.2, 1.0), turn_deg * swing),
        )

    return path


def _with(thing: Path, offset: np.ndarray) -> Path:
    """A hand that comes, takes a thing, and holds it."""

    def path(time: float) -> np.ndarray:
        near = ease(time, 0.1, 0.7)
        held = thing(time) @ offset
        away = held.copy()
        away[:3, 3] = FAR
        held[:3, 3] = (1 - near) * away[:3, 3] + near * held[:3, 3]
        return held

    return path


def _slides(x: float, y: float, out: float, yaw: float) -> Path:
    """Moves to the right over the border of the picture, stays there, turning a little, and comes back."""

    def path(time: float) -> np.ndarray:
        share = ease(time, 0.3, 1.0) - ease(time, 3.5, 4.0)
        return standing(x + out * share, y, yaw + 12 * np.sin(1.5 * time) * share)

    return path


def _sinking(time: float) -> np.ndarray:
    """A camera that looks from above first."""
    low = ease(time, 0.0, 0.8)
    return before(0.75 - 0.05 * np.sin(time), 65 - 40 * low + 3 * np.sin(1.3 * time), 6 * np.sin(1.5 * time))


def every(meshes: Mapping[str, Mesh], symmetric: set[str]) -> list[Sequence]:
    """All sequences with things that are half hidden."""
    hand = Actor({"base": things.hand()}, lambda time: np.eye(4), tracked=False)

    def actor(name: str, path: Path) -> Actor:
        return Actor({"base": meshes[name]}, path, symmetric=name in symmetric)

    def made(name: str, actors: dict[str, Actor], grip: Path | None = None, camera: Path | None = None) -> Sequence:
        if grip is not None:
            actors = {**actors, "hand": Actor(hand.links, grip, tracked=False)}
        return Sequence(name, actors, camera or (lambda time: before()), SECONDS)

    flat = things.turned((1, 0, 0), 25.0)
    across = things.turned((0, 0, 1), 90.0) @ things.turned((0, 1, 0), 20.0)
    juice, can = _carried(0.0, 0.02, 0.08, 8.0), _carried(0.0, 0.0, 0.10, 8.0)
    return [
        made(
            "hand_before",
            {"macaroni_and_cheese": actor("macaroni_and_cheese", lambda time: standing(0.0, 0.05, 20))},
            _comes((0.045, -0.16, 0.12), flat),
        ),
        made(
            "hand_before_plain",
            {"duck": actor("duck", lambda time: standing(0.0, 0.05, 40))},
            _comes((0.053, -0.16, 0.10), flat),
        ),
        made(
            "held_carton",
            {"orange_juice": actor("orange_juice", juice)},
            _with(juice, _placed(np.array([0.03, -0.06, 0.06]), across)),
        ),
        made("held_can", {"can": actor("can", can)}, _with(can, _placed(np.array([-0.03, -0.06, 0.04]), across))),
        made(
            "thing_before_thing",
            {
                "red_coffee_mug": actor("red_coffee_mug", lambda time: standing(0.0, 0.12, 60)),
                "cookies": actor("cookies", _comes((0.01, -0.18, 0.18), things.turned((0, 0, 1), 10.0), BESIDE)),
            },
        ),
        made(
            "things_behind_things",
            {
                "white_yellow_mug": actor("white_yellow_mug", lambda time: standing(-0.08, 0.10, -30)),
                "stanfordbunny": actor("stanfordbunny", lambda time: standing(0.13, 0.10, 30)),
                "orange_juice": actor("orange_juice", lambda time: standing(-0.08, -0.02, 5)),
                "black_book": actor("black_book", lambda time: standing(0.17, -0.01, 80)),
            },
            camera=_sinking,
        ),
        made(
            "over_the_border",
            {
                "gelatin_box": actor("gelatin_box", _slides(0.15, 0.0, 0.255, 10)),
                "piggybank": actor("piggybank", _slides(-0.10, 0.1, -0.32, 70)),
            },
        ),
    ]
