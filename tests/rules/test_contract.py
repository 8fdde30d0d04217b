"""What holds for every rule and every backend."""

from __future__ import annotations

import ast
import inspect
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from dextera_build.artifacts.core.field_docs import bounds, field_docs
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.code.loader import Library, RuleFile
from dextera_build.project.project import Project
from dextera_build.recipe import limits, profiles
from dextera_build.recipe.backends import Choice, with_used
from dextera_build.recipe.calls import facts_of
from dextera_build.recipe.folders import every, kind_of
from dextera_build.rule import Options

LIBRARY = Library(machine=Project(Path(__file__).parents[2]).machine)
RULES = list(LIBRARY.rules())
PROFILES = [profiles.read(name, None) for name in profiles.names(None)]
UNITS = re.compile(r"^seconds$|_(m|m2|m3|mm|px|rad|deg|s|s2|hz|kg|gb|n|nm|j|ratio|fraction|factor|iou|sigma|sigmas)$")
HEAVY = ("torch", "open3d", "mujoco", "cv2", "trimesh", "coacd", "pxr", "viser", "scipy", "manifold3d")


CATALOGUE, WAYS = "dextera_build/sim/primitives/catalogue.py", "dextera_build/sim/experts/candidates.py"
"""Modules that find the files of primitives by name."""
FILES = ("primitive", "script")
SHOW_TASKS = {"demonstrate.film", "evaluate.film"}
"""Rules that import a simulator of tasks, and only show recorded steps."""


def of_every_rule(question: Callable[[RuleFile], None]) -> Callable[[], None]:
    """A test that asks every rule, and names those that fail."""

    def ask() -> None:
        wrong = {}
        for found in RULES:
            try:
                question(found)
            except Exception as error:
                wrong[found.path] = f"{type(error).__name__}: {error}"
        assert not wrong

    return ask


def test_there_are_rules():
    assert len(RULES) > 20


@of_every_rule
def test_it_says_what_it_returns(found):
    assert found.rule.summary.startswith("Return "), found.rule.summary
    assert found.rule.summary.endswith(".")


def kinds(found: RuleFile) -> dict[str, type[Options]]:
    """Address -> class of the options of a rule, of its backends, and of folders that an option names."""
    own = {f"{found.path}.{name}": backend.options for name, backend in found.backends.items()}
    own |= {f"{found.path}.{file.name}": kind_of(file) for _, file in every(LIBRARY, found)}
    return {found.path: found.rule.options} | {path: kind for path, kind in own.items() if kind is not None}


@of_every_rule
def test_options_are_described(found):
    for kind in kinds(found).values():
        assert set(field_docs(kind)) == set(kind.model_fields)


@of_every_rule
def test_its_options_have_defaults_that_fit(found):
    for path, kind in kinds(found).items():
        if path != found.path and found.rule.folders:
            continue  # a goal may need one of several options
        required = [name for name, field in kind.model_fields.items() if field.is_required()]
        if not required:
            plain = kind().model_dump(mode="json")
            assert kind.model_validate_json(json.dumps(plain)).model_dump(mode="json") == plain


@of_every_rule
def test_lengths_and_angles_name_their_unit(found):
    for path, kind in kinds(found).items():
        said = field_docs(kind)
        for name, field in kind.model_fields.items():
            described = re.search(r"\[(m|rad|s|kg|px|deg|mm|Hz)[\]^/ ]", said.get(name, ""))
            if described and field.annotation is float:
                assert UNITS.search(name), f"{path}.{name} is in [{described[1]}], its name does not say so"


UNBOUNDED = re.compile(
    r"^(yaw_deg|at_m|(from|to|eye|target|shift|origin|centre)_m|(floor_z|wall_y|pedestal|surface)_m|([xy]_)?axis|direction"
    r"|facing|pointing|(inertia_)?quaternion|(lower|upper|home|offset|open|closed)_rad|joints_deg|clock_offset_s|ratio)$"
)
"""Positions, directions, signed angles and ratios, which may have either sign."""
POSITIONS = {
    "align.base.position_m",
    "align.support.base_above_m",
    "reference.world.robot.position_m",
    "reference.move_camera.turn_deg",
    "reference.open_joints.positions_deg",
    "reference.world.objects.blocks.turn_deg",
    "reference.world.objects.moves.range_deg",
    "reference.world.objects.moves.position_deg",
    "factorize.listed.elements.joints.range_deg",
    "factorize.listed.elements.joints.at_deg",
    "demonstrate.operate.hands.heading_deg",
    "demonstrate.operate.hands.limits.workspace_m",
    "simulate.cell.limits.workspace_m",
    "simulate.imported_robot.limbs.gripper.open",
    "simulate.imported_robot.limbs.gripper.closed",
    "simulate.robot.limbs.gripper.open",
    "simulate.robot.limbs.gripper.closed",
    *(f"simulate.task.{primitive}.by_m" for primitive in ("push", "pick_and_place", "pick_and_reorient")),
    *(f"simulate.task.{primitive}.turn_deg" for primitive in ("pick_and_place", "pick_and_reorient")),
}


def numbers(kind: type[BaseModel], path: str) -> Iterator[tuple[str, str]]:
    """(option, its declared form) of every option that holds numbers, those of nested groups included."""
    for name, field in kind.model_fields.items():
        form = f"{field.annotation!r} {field.metadata!r}"
        inner = [part for part in parts_of(field.annotation) if isinstance(part, type) and issubclass(part, BaseModel)]
        for part in inner:
            yield from numbers(part, f"{path}.{name}")
        if not inner and re.search(r"\b(int|float)\b", form):
            yield f"{path}.{name}", form


def parts_of(annotation: object) -> Iterator[object]:
    yield annotation
    for part in get_args(annotation):
        yield from parts_of(part)


@of_every_rule
def test_every_number_has_the_bound_that_physics_gives_it(found):
    free = [
        option
        for path, kind in kinds(found).items()
        for option, form in numbers(kind, path)
        if not re.search(r"\b(Ge|Gt|Le|Lt)\(", form)
        and not UNBOUNDED.match(option.rsplit(".", 1)[-1])
        and option not in POSITIONS
    ]
    assert free == []


def fields(kind: type[BaseModel]) -> Iterator[tuple[str, FieldInfo]]:
    """Every option that holds numbers, those of nested groups included."""
    for name, field in kind.model_fields.items():
        inner = [part for part in parts_of(field.annotation) if isinstance(part, type) and issubclass(part, BaseModel)]
        for part in inner:
            yield from fields(part)
        if not inner and re.search(r"\b(int|float)\b", f"{field.annotation!r}"):
            yield name, field


@of_every_rule
def test_every_number_has_an_upper_bound_that_its_default_keeps(found):
    for path, kind in kinds(found).items():
        for name, field in fields(kind):
            limit = limits.largest(name, field)
            assert limit is None or 0 < limit < math.inf
            assert limit is not None or "<" in bounds(field), f"{path}.{name}"
            default = field.get_default(call_default_factory=True)
            values = [default] if isinstance(default, int | float) else default if isinstance(default, tuple) else []
            assert all(abs(value) <= (limit or math.inf) for value in values), f"{path}.{name}"


@of_every_rule
def test_its_facts_can_be_stated(found):
    for backend in [None, *found.backends.values()]:
        if backend is None or not backend.missing():
            facts = facts_of(LIBRARY, found, Choice(backend, "this test") if backend else None)
            assert f"rules/{found.file.relative_to(found.root.path).as_posix()}" in facts.code
            assert facts.types["return"]


@of_every_rule
def test_a_rule_that_plays_or_judges_tasks_has_their_primitives_in_its_key(found):
    tasks = {name for name, slot in found.rule.slots.items() if slot.annotation is TaskBundle}
    if found.path in SHOW_TASKS:
        return
    for backend in found.backends.values():
        code = LIBRARY.code.of(found.file, *(each.file for each in with_used(found, backend))).definitions
        run = {file: {slot for slot, files in found.rule.runs.items() if file in files} for file in FILES}
        assert CATALOGUE not in code or tasks <= run["primitive"], backend.name
        assert WAYS not in code or tasks & run["script"], backend.name


@of_every_rule
def test_every_profile_of_ci_has_a_backend(found):
    if found.backends:
        chosen = {profile for backend in found.backends.values() for profile in backend.facts.profiles}
        assert {"stub", "cpu"} <= chosen


@of_every_rule
def test_every_profile_names_backends_that_exist(found):
    for profile in PROFILES if found.backends else ():
        names, _ = profile.preferred(found)
        assert names, profile.name
        assert set(names) <= found.backends.keys(), profile.name


@of_every_rule
def test_its_backends_have_the_functions_of_its_protocol(found):
    if not found.backends:
        return
    protocol = found.rule.protocol
    assert protocol is not None, f"declare `ctx: Context[...]` of {found.path} with a Protocol"
    methods = {name: each for name, each in vars(protocol).items() if inspect.isfunction(each) and name[0] != "_"}
    assert methods
    for backend in found.backends.values():
        if backend.missing():
            continue
        for name, method in methods.items():
            asked = list(inspect.signature(method).parameters)[1:]
            given = list(inspect.signature(getattr(backend.module, name)).parameters)
            assert given == asked
            assert (asked[0], asked[-1]) == ("ctx", "options")


@of_every_rule
def test_a_backend_says_what_it_is(found):
    for backend in found.backends.values():
        assert backend.facts.summary
        assert backend.facts.licence
        assert not backend.facts.summary.endswith(".")


@of_every_rule
def test_its_file_imports_nothing_heavy(found):
    for node in ast.parse(found.file.read_text()).body:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not [name for name in names if name.partition(".")[0] in HEAVY]


@pytest.mark.medium
def test_no_rule_drags_in_a_heavy_package():
    """Planning imports every rule of a recipe; that must stay quick."""
    code = (
        "import sys\nfrom dextera_build.code.loader import Library\n"
        "[found.rule for found in Library().rules()]\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
