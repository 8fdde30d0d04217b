"""demonstrate.teach in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import cameras
from dextera_build.policy.added import of_specs
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.running import Runner
from dextera_build.policy.terms import Sensor
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import pictures
from dextera_build.sim.observe.sensors import Sensors
from dextera_build.sim.runtime.drawable import drawable
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.policies import load
from dextera_build.sim.training.teaching import Teacher, lesson

if TYPE_CHECKING:
    from .teach import TeachOptions

BACKEND = Backend(
    summary="MuJoCo; networks by torch on one thread",
    profiles=("cpu",),
    packages=("mujoco", "torch", "safetensors"),
    extra="learn",
)


def teach(
    ctx: Context,
    bundle: TaskBundle,
    teacher: Checkpoint,
    student: Checkpoint | None,
    views: Mapping[str, View],
    seeds: list[int],
    terms: tuple[TermSpec, ...],
    common: TeachOptions,
    options: Options,
) -> Iterator[tuple[Episode, float]]:
    """Each seed's episode; a start that cannot be drawn is replaced by the next that can."""
    environment = Environment(bundle, terms=of_specs(terms, ctx.companion))
    asked = Teacher(ctx.companion("teacher", teacher.contract.algorithm, Runner), teacher, environment)
    taught = None
    if student is not None:
        runner = ctx.companion("student", student.contract.algorithm, Runner)
        taught = load(runner, student, bundle, views, terms=terms)
    sensors = Sensors(of_bundle(bundle, views, terms=environment.specs).terms(None, _sensors(common)), {})
    sees = [channel.name for channel in student.contract.seen] if student is not None else []
    looking = {name: views[name] for name in sorted({cameras.camera_of(each) for each in sees})}
    outputs = {cameras.term_of(each) for each in sees}
    opened = pictures.live(environment, looking, outputs) if looking else nullcontext()
    with opened as look:
        for seed in seeds:
            start = drawable(environment.draw, seed)
            made = lesson(environment, asked, taught, start, sensors, led=common.led, look=look)
            yield made.episode, made.apart_rad


def _sensors(options: TeachOptions) -> dict[str, Sensor]:
    turn = math.radians(options.rotation_deg)
    return {
        "joints": Sensor(sigma=math.radians(options.joint_deg)),
        "objects": Sensor(delay_s=options.delay_s, loss=options.loss, sigma=options.position_m, turn_sigma_rad=turn),
        "displacement": Sensor(delay_s=options.delay_s, loss=options.loss, sigma=turn),
    }
