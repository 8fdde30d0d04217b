"""The card of a data set: every form has one, which says what the episodes say."""

from __future__ import annotations

import re
import tempfile
from typing import Any

import numpy as np
import pytest
import yaml

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film, Segment
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.rules.demonstrate.test_lerobot import filmed, of_lengths

FORMS = ("lerobot", "mcap", "robomimic", "rlds")


def card(form: str, made: Episodes, film: Film | None = None, bundle: TaskBundle | None = None, **options: Any) -> str:
    inputs: dict[str, Any] = {"episodes": made}
    if film is not None:
        inputs |= {"film": film, "view": episodes.view(film.width, film.height)}
    with tempfile.TemporaryDirectory() as scratch:
        folder: Folder = RuleRunner(scratch).run(
            f"demonstrate.{form}", options=options, bundle=bundle or episodes.bundle(), **inputs
        )
        return folder.files["README.md"].decode()


def mixed() -> Episodes:
    """Ten attempts: five episodes, one led back, and discarded ones with three reasons."""
    made = of_lengths([20, 40, 60, 80, 100])
    led = Segment(name="recover", first=0, last=5, frame="box", contact=False)
    items = {**made.items, "3": made.items["3"].model_copy(update={"segments": (led,), "origin": "synthesis"})}
    reasons = ("slipped by 3 mm", "slipped by 12 mm", "out of reach", "", "")
    lost = {
        f"lost {number}": made.items["0"].model_copy(update={"success": False, "reason": reason})
        for number, reason in enumerate(reasons)
        if reason
    }
    return made.model_copy(update={"items": items, "failures": lost, "attempts": 10})


@pytest.mark.parametrize("form", FORMS)
def test_counts_yield_and_reasons(form: str) -> None:
    text = card(form, mixed())
    assert "5 episodes, 300 steps at 20 Hz" in text
    assert "| attempts | 10, of which 5 were kept (50 %) |" in text
    assert "| length | 1.0 to 5.0 s, median 3.0 s |" in text
    assert "| actions by | operator (4), synthesis (1) |" in text
    assert "| led back to the path after a disturbance | 1 |" in text
    assert "| slipped by N mm | 2 |" in text
    assert "| out of reach | 1 |" in text
    assert "There are no pictures." in text


@pytest.mark.parametrize("form", FORMS)
def test_its_head_is_what_the_hub_reads_and_its_code_is_python(form: str) -> None:
    text = card(form, of_lengths([3, 4]), licence="cc-by-4.0")
    head = yaml.safe_load(text.split("---\n")[1])
    assert head["license"] == "cc-by-4.0"
    assert head["task_categories"] == ["robotics"]
    compile(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], "card", "exec")
    assert "license" not in yaml.safe_load(card(form, of_lengths([3, 4])).split("---\n")[1])


def test_numbers_have_units_frames_and_an_order() -> None:
    text = card("robomimic", of_lengths([3, 4]))
    assert "| `obs/object` | 14 | m, unit quaternion | base | poses of the objects |" in text
    assert "contact" not in text.partition("## What a step holds")[2].partition("Frame `base`")[0]
    assert "* joints: `joint_1`, `joint_2`, `joint_3`" in text
    assert "| `/wrench/{}` | 6 | N | base |" in card("mcap", of_lengths([3, 4]))


def test_the_camera_is_in_the_base_of_the_robot() -> None:
    made = of_lengths([3, 4])
    text = card("rlds", made, filmed(made))
    view, bundle = episodes.view(16, 16), episodes.bundle()
    place = (np.linalg.inv(bundle.base_pose.matrix) @ view.camera_pose.matrix)[:3, 3]
    assert f"it stands at ({', '.join(f'{value:.3f}' for value in place)}) m" in text
    assert "| `observation/image` | 16 x 16 x 3 | sRGB 0..255 |" in text


@pytest.mark.parametrize(("kind", "said"), [("twin", "Domain: the twin"), ("reference", "Domain: the reference world")])
def test_the_domain_is_that_of_the_episodes(kind: str, said: str) -> None:
    text = card("lerobot", of_lengths([3]).model_copy(update={"world": kind}))
    assert said in text
    assert "No episode was recorded on hardware." in text


def test_licences_of_meshes_are_named() -> None:
    bundle = episodes.bundle()
    files = {**bundle.robot.model.files, "licences/0_LICENSE": b"\n# MIT License\n\nCopyright"}
    robot = bundle.robot.model_copy(update={"model": Folder(files=files), "source": "a data sheet"})
    text = card("lerobot", of_lengths([3]), bundle=bundle.model_copy(update={"robot": robot}))
    assert "* Robot: a data sheet. Licences of its files: `0_LICENSE`: MIT License." in text
    world = bundle.model_copy(
        update={"kind": "reference", "model": Folder(files={**bundle.model.files, "meshes/LICENSE.txt": b"CC-BY 4.0"})}
    )
    assert "Licences of its files: `LICENSE.txt`: CC-BY 4.0." in card("lerobot", of_lengths([3]), bundle=world)
