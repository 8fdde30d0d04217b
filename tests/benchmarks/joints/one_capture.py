"""Hinges from one capture against those of generated laptops and boxes with a lid, and joints found in rigid things.

`python -m tests.benchmarks.joints.one_capture` prints what is found over the side that is seen (0 is the front, 180 the
back) and the opening. The mesh is fitted by `factorize.mesh` with the families that such things are taken for: box,
leaning box, open box and panels. Somebody said that the object has a joint. With `--rigid`, somebody says so of things
that have none: every joint is a false one.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.objects.object import Body, Joint
from dextera_build.artifacts.objects.view import Instance
from dextera_build.errors import RuleError
from dextera_build.geometry import solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.testing import RuleRunner
from tests import object_views

from . import sight
from .__main__ import Found, judged
from .kinds import KINDS, Thing

FAMILIES = {"primitives": {"hypotheses": ["box", "tilted_box", "panels", "open_box"]}}
SIDES = (0, 45, 90, 135, 180)
"""Sides from which things are seen [deg]."""
PITCH = np.radians(40.0)


def opened(kind: str, seed: int, opening_deg: float, side_deg: float) -> tuple[Thing, sight.Stand, Instance]:
    """A thing, its place, and a view of it with its first joint at an opening."""
    draw = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    thing = KINDS[kind](draw)
    thing = thing.at({thing.joints[0].name: np.radians(opening_deg)})
    place = sight.stand(thing, draw, np.radians(side_deg), PITCH)
    return thing, place, sight.look(thing, place, seed)


def articulated(runner: RuleRunner, instance: Instance) -> Body:
    """Mesh, links and joints of what somebody called articulated.

    Raises:
        RuleError: No joint was found.
    """
    shape = runner.run("factorize.mesh", options=FAMILIES, **object_views.sights(instance))
    traits = instance.traits.model_copy(update={"body_type": "articulated"})
    inputs = {**object_views.whole(instance), "traits": traits}
    body: Body = runner.run("factorize.articulate", shape=shape, **inputs)
    return body


def found(runner: RuleRunner, kind: str, seed: int, opening_deg: float, side_deg: float) -> tuple[Found, float] | None:
    """What was found of a hinge, and the error of its position [deg]; None if nothing was."""
    thing, place, instance = opened(kind, seed, opening_deg, side_deg)
    try:
        body = articulated(runner, instance)
    except RuleError:
        return None
    assert body.pose is not None
    (joint,) = body.joints
    truth = moved(thing.joints[0], body.pose.inverse().matrix @ place.pose)
    return judged(truth, joint), float(np.degrees(joint.position)) - opening_deg


def moved(joint: Joint, motion: np.ndarray) -> Joint:
    """A joint in another frame."""
    origin = transforms.apply(motion, np.array(joint.origin)).tolist()
    axis = (motion[:3, :3] @ np.array(joint.axis)).tolist()
    return joint.model_copy(update={"origin": tuple(origin), "axis": tuple(axis)})


def rigid(seed: int) -> Iterator[tuple[str, Solid]]:
    """Things without a joint, of drawn sizes."""
    draw = np.random.default_rng([seed, 99])
    x, y, z = draw.uniform((0.12, 0.1, 0.05), (0.3, 0.22, 0.16))
    yield "box", solids.box((x, y, z), (0, 0, z / 2))
    yield "thin box", solids.box((x, y, 0.02), (0, 0, 0.01))
    top = solids.box((0.8 * x, 0.85 * y, 0.03), (0.01, -0.01, 0.045))
    turn = transforms.rotation_between(np.array([1.0, 0, 0]), np.array([np.cos(0.2), np.sin(0.2), 0]))
    yield (
        "stacked books",
        solids.join([solids.box((x, y, 0.03), (0, 0, 0.015)), top.moved(transforms.rigid(turn, np.zeros(3)))]),
    )
    yield "bowl", object_views.bowl()
    yield "mug", object_views.mug()
    yield "bracket", object_views.bracket()
    yield "cup", object_views.cup()
    wedge = np.array([[-y / 2, 0], [y / 2, 0], [y / 2, z]])
    roll = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    yield "wedge", solids.extrude(wedge, -x / 2, x / 2).moved(transforms.rigid(roll, np.zeros(3)))


def _curve(runner: RuleRunner, kind: str, openings: list[float], seeds: range) -> None:
    print(f"\n{kind.replace('_', ' ')}: within 2 deg and 3 mm / found, of {len(seeds)}; median and worst pivot [mm]\n")
    print(f"| opened by [deg] | {' | '.join(f'{side} deg' for side in SIDES)} |\n|---|{'---|' * len(SIDES)}")
    for opening in openings:
        cells = []
        for side in SIDES:
            all_ = [each for seed in seeds if (each := found(runner, kind, seed, opening, side)) is not None]
            off = [each.pivot_mm for each, _ in all_]
            good = sum(each.good for each, _ in all_)
            cells.append(f"{good} / {len(all_)}" + (f"; {np.median(off):.1f}, {max(off):.1f}" if off else ""))
        print(f"| {opening:.0f} | {' | '.join(cells)} |", flush=True)


def _false(runner: RuleRunner, seeds: range) -> None:
    print("| thing | views | false joints |\n|---|---|---|")
    counts: dict[str, list[bool]] = {}
    for seed in seeds:
        for name, solid in rigid(seed):
            for side in SIDES:
                draw = np.random.default_rng([seed, side])
                thing = Thing({"base": solid}, ())
                instance = sight.look(thing, sight.stand(thing, draw, np.radians(side + 10.0), PITCH), seed)
                try:
                    made = bool(articulated(runner, instance).joints)
                except RuleError:
                    made = False
                counts.setdefault(name, []).append(made)
    for name, made in counts.items():
        print(f"| {name} | {len(made)} | {sum(made)} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--objects", type=int, default=2, help="objects of each kind")
    parser.add_argument("--start", type=int, default=1000, help="seed of the first one")
    parser.add_argument("--kinds", default="laptop,box_with_lid")
    parser.add_argument("--openings", default="8,15,35,70,105", help="[deg]")
    parser.add_argument("--rigid", action="store_true", help="things without a joint instead")
    given = parser.parse_args()
    seeds = range(given.start, given.start + given.objects)
    with tempfile.TemporaryDirectory() as scratch:
        runner = RuleRunner(scratch)
        if given.rigid:
            _false(runner, seeds)
            return
        for kind in given.kinds.split(","):
            _curve(runner, kind, [float(each) for each in given.openings.split(",")], seeds)


if __name__ == "__main__":
    main()
