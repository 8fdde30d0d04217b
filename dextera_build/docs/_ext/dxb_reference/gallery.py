"""The gallery: what recipes build, each with its summary from the recipe and the command that builds it."""

from __future__ import annotations

from typing import NamedTuple

import yaml

from dextera_build.code.loader import bundled

from .markdown import join


class Shown(NamedTuple):
    """One picture of the gallery."""

    recipe: str
    """Address of the recipe that the picture was made with."""
    picture: str
    """File in `images/`."""
    seen: str
    """What the picture shows."""
    page: str
    """The page that describes it."""
    arguments: str = ""
    """Further arguments of the command, as the page has them."""
    credit: str = ""
    """Source and licence of a photograph that is not the project's."""


SHOWN = (
    Shown("twin/laptop_scene", "laptop_scene.jpg", "A photograph, its masks, and the twin", "quickstart.md"),
    Shown(
        "twin/tabletop",
        "real_twin.jpg",
        "A real photograph, and its twin from three sides",
        "quickstart.md",
        "--input capture=../capture",
        credit="NVlabs/6dof-graspnet, MIT",
    ),
    Shown("task/close_laptop", "close_laptop.jpg", "A rollout in the twin and in the reference world", "tasks.md"),
    Shown("benchmark/tasks", "tasks.jpg", "Eighteen tasks, performed by the scripted operator", "tasks.md"),
    Shown(
        "twin/two_states",
        "joints.jpg",
        "Joints from one capture and from two",
        "joints.md",
        "--input capture=before --input moved=after",
    ),
    Shown(
        "twin/tracked",
        "tracking.jpg",
        "A carton and a lid, tracked past a hand and a moving camera",
        "tracking.md",
        "--input capture=capture --input recording=film",
    ),
    Shown(
        "twin/generated_room",
        "scene_alignment.jpg",
        "A generated room, laid over the photograph",
        "scene_alignment.md",
        "--input capture=capture --input image=image --input generated=room.ply",
    ),
    Shown(
        "benchmark/stage_two",
        "stage_two.jpg",
        "Robot and objects, placed in drawn scenes",
        "benchmarks/second_stage.md",
        "--input meshes=.venv/objects",
    ),
    Shown(
        "task/from_hands",
        "teleop_film.jpg",
        "A take by hand: the robot's hand, and the operator's",
        "teleoperation.md",
        "--input task=task/kl/lift_mustard_bottle:task --input operator=recordings/lift_mustard_bottle.mcap",
    ),
    Shown(
        "robot/kuka_leap",
        "robot_hands.jpg",
        "Hands that close as an operator's do",
        "robots.md",
        "--set 'robot.hands={arm: {side: right}}'",
    ),
    Shown("benchmark/recalibration", "recalibration.svg", "How far a knock moved each pose", "calibration.md"),
)


def page() -> str:
    """A list with one item per picture.

    Raises:
        FileNotFoundError: A recipe is not there any more.
    """
    return join("{.cards .wide}\n" + "\n".join(_item(each) for each in SHOWN))


def command(shown: Shown) -> str:
    """What one types to build it."""
    return f"dxb build {shown.recipe} {shown.arguments}".rstrip()


def _item(shown: Shown) -> str:
    told = yaml.safe_load((bundled("recipes") / f"{shown.recipe}.yaml").read_text(encoding="utf-8"))["summary"]
    parts = (
        f"[![{shown.seen}](images/{shown.picture})]({shown.page})",
        f"**[{shown.seen}]({shown.page})**",
        f"{told} Photograph: {shown.credit}." if shown.credit else f"{told}",
        f"```console\n$ {command(shown)}\n```",
    )
    text = "\n\n".join(parts).replace("\n", "\n  ")
    return f"- {text}\n"
