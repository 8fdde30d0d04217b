"""Tables IV and V of the paper (DEXTERA), as data: success on hardware, for comparison.

`OB` is OpenArm with BrainCo Revo1 hands, `KL` a KUKA LBR iiwa 7 with a LEAP Hand.
"""

from __future__ import annotations

from dextera_build.statistics import Rate

POLICIES = ("ACT", "DP", "BC-RNN", "OpenVLA", "pi0.5", "T-S")
"""Columns of Table V; `T-S` is a student distilled from a PPO teacher, the others are imitation learning."""
TRIALS = (100, 20)
"""Trials per cell of Table V, in simulation and on hardware."""
REPLAYS = 30
"""Replays per row of Table IV."""

_TABLE_4 = """
OB LiftToyBus               25
OB LiftBlueMug              30
OB PlaceToyBusInBasket      28
OB HandoverGrayBowl         24
OB BimanualLiftBasket       25
OB ReorientThermometer      22
OB BimanualLiftBox          30
OB PushBlueCube             24
OB BimanualPlaceBoxInBasket 22
OB CloseLaptop              30
KL PlaceCoconutWaterInBasket 26
KL LiftMustardBottle        27
KL CloseLaptop              30
"""
"""Embodiment, task, number of successful rollouts in simulation and on hardware."""

_TABLE_5 = """
OB LiftToyBus               67/55  71/50  5/0   14/5  73/65  53/20
OB LiftBlueMug              82/100 89/90  19/5  35/10 85/100 21/10
OB PlaceToyBusInBasket      24/15  32/0   6/0   42/10 36/10  16/0
OB HandoverGrayBowl         75/65  15/0   0/0   17/0  63/40  53/10
OB BimanualLiftBasket       70/80  69/45  27/5  8/0   84/90  62/30
OB ReorientThermometer      30/55  20/15  3/0   8/0   46/50  3/0
OB BimanualLiftBox          47/35  82/50  13/0  12/5  84/60  49/0
OB PushBlueCube             41/50  15/35  32/10 19/20 33/55  38/10
OB BimanualPlaceBoxInBasket 36/10  23/5   3/0   1/0   60/20  7/0
OB CloseLaptop              46/80  87/100 27/45 50/45 99/100 96/30
KL PlaceCoconutWaterInBasket 52/25 3/0    23/0  10/0  10/5   57/15
KL LiftMustardBottle        88/35  32/20  38/0  70/20 78/40  41/25
KL CloseLaptop              100/100 57/75 90/80 83/65 91/100 82/75
"""
"""Embodiment, task, per policy the success in simulation and on hardware [%]."""

Pair = tuple[str, str]
"""Embodiment and task."""


def _replays() -> dict[Pair, Rate]:
    rows = [line.split() for line in _TABLE_4.strip().splitlines()]
    return {(robot, task): Rate(int(count), REPLAYS) for robot, task, count in rows}


def _policies() -> dict[Pair, dict[str, tuple[Rate, Rate]]]:
    found = {}
    for line in _TABLE_5.strip().splitlines():
        robot, task, *cells = line.split()
        found[robot, task] = {name: _rates(cell) for name, cell in zip(POLICIES, cells, strict=True)}
    return found


def _rates(cell: str) -> tuple[Rate, Rate]:
    simulated, measured = (
        Rate(int(percent) * count // 100, count) for percent, count in zip(cell.split("/"), TRIALS, strict=True)
    )
    return simulated, measured


REPLAY: dict[Pair, Rate] = _replays()
"""Table IV: replays on hardware."""
POLICY: dict[Pair, dict[str, tuple[Rate, Rate]]] = _policies()
"""Table V: policy -> success in simulation and on hardware."""
