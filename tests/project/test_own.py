"""A project's own recipes, and the twin that messages name."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.cli.consoles import lines
from dextera_build.project import own
from dextera_build.project.project import find


@pytest.mark.parametrize(
    ("files", "twin"),
    [
        ((), "twin/laptop_scene"),
        (("robot/arm",), "twin/laptop_scene"),
        (("twin/desk", "twin/desk_again", "robot/arm"), "twin/desk"),
        (("twin/a_again", "twin/bench"), "twin/bench"),
    ],
)
def test_tasks_for_a_robot_are_proposed_in_the_projects_own_twin(tmp_path: Path, files: tuple[str, ...], twin: str):
    (tmp_path / "dxb.toml").write_text("")
    for name in files:
        (tmp_path / f"recipes/{name}.yaml").parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / f"recipes/{name}.yaml").write_text("extends: twin/tabletop\n")
    project = find(tmp_path)
    assert own.recipes(project) == sorted(files)
    assert own.twin(project) == twin
    said = "".join(text for text, _ in lines.next_steps("robot/arm", own.twin(project)))
    assert said.endswith(f"tasks: dxb new task {twin} robot/arm")
    assert "new task" not in "".join(text for text, _ in lines.next_steps("twin/desk", twin))
