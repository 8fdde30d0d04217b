"""The card of a data set, `README.md`: what is in it, where it comes from and how to open it, as the data say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np
import yaml

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View, WorldKind
from dextera_build.errors import listing
from dextera_build.policy import actions, layout
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.terms import Declared
from dextera_build.sim.model.published import stated

from . import facts

if TYPE_CHECKING:
    from .cameras import Camera
    from .form import Form, FormOptions

FILE = "README.md"
DOMAINS: dict[WorldKind, str] = {
    "twin": "the twin: a simulation in MuJoCo of a scene that was built from a capture",
    "reference": "the reference world: a simulation with shapes and physics of its own, in the place of hardware",
    "perturbed": "the perturbed twin: a simulation with other shapes and physics, in the place of hardware",
    "real": "hardware: recordings of a robot",
}
"""Kind of world -> the domain of its episodes."""
NOWHERE = " No episode was recorded on hardware."
MOST_REASONS = 12


def write(
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    form: Form,
    options: FormOptions,
    out: Path,
) -> None:
    """Write the card below `out`."""
    parts = (
        _head(form, options),
        _title(bundle, episodes, form, options),
        _episodes(episodes),
        _numbers(bundle, episodes, seen, form),
        _cameras(bundle, seen),
        _origin(bundle, options),
        ["## Opening it", "", "```python", form.load.strip(), "```"],
    )
    text = "\n".join(line for part in parts for line in (*part, ""))
    trees.write({FILE: (text.rstrip() + "\n").encode()}, out)


def _head(form: Form, options: FormOptions) -> list[str]:
    """The entries that the Hub reads."""
    entries: dict[str, object] = {"license": options.licence} if options.licence else {}
    entries |= {"task_categories": ["robotics"], **form.header}
    return ["---", yaml.safe_dump(entries, sort_keys=False, allow_unicode=True).strip(), "---"]


def _title(bundle: TaskBundle, episodes: Episodes, form: Form, options: FormOptions) -> list[str]:
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    count, words = len(episodes.items), facts.instruction(bundle, options)
    return [
        f"# {bundle.task.name}, {bundle.robot.model_name}",
        "",
        f"{_plural(count, 'episode')}, {steps:,} steps at {episodes.rate_hz:g} Hz "
        f'({steps / episodes.rate_hz / 60:.1f} min), of the task "{words}", as {form.title}.',
        "",
        f"Domain: {DOMAINS[episodes.world]}.{'' if episodes.world == 'real' else NOWHERE}",
    ]


def _episodes(episodes: Episodes) -> Iterator[str]:
    """Counts, yield, and the reasons of discarded attempts."""
    seconds = np.array([len(episode.joints) for episode in episodes.items.values()]) / episodes.rate_hz
    origins = Counter(episode.origin for episode in episodes.items.values())
    led = sum(any(each.name == "recover" for each in episode.segments) for episode in episodes.items.values())
    kept = len(episodes.items)
    rows = [
        (
            "attempts",
            f"{episodes.attempts:,}, of which {kept:,} were kept ({100 * kept / max(1, episodes.attempts):.0f} %)",
        ),
        ("length", f"{seconds.min():.1f} to {seconds.max():.1f} s, median {np.median(seconds):.1f} s"),
        ("different starts", f"{len({episode.start.seed for episode in episodes.items.values()}):,}"),
        ("actions by", ", ".join(f"{name} ({count:,})" for name, count in sorted(origins.items()))),
        ("led back to the path after a disturbance", f"{led:,}"),
    ]
    yield from ("## Episodes", "", *_table(("", ""), rows))
    if not episodes.failures:
        return
    reasons = list(episodes.reasons.items())
    shown = [(reason, str(count)) for reason, count in reasons[:MOST_REASONS]]
    rest = sum(count for _, count in reasons[MOST_REASONS:])
    shown += [("others", str(rest))] if rest else []
    yield from ("", *_table(("discarded because", "attempts"), shown))


def _numbers(bundle: TaskBundle, episodes: Episodes, seen: Sequence[Camera], form: Form) -> Iterator[str]:
    """What a step holds, and in which order."""
    here = layout.of_episodes(episodes, bundle.task.goal.names)
    rows = list[tuple[str, ...]]()
    for term in here.terms():
        place = form.place(term.declared)
        if term.feature and place:
            rows.append((f"`{place}`", str(len(term.components)), *_about(bundle, term.declared)))
    for each in seen:
        rows += _pictures(each, form)
    yield from ("## What a step holds", "")
    yield from _table(("where", "numbers", "unit", "frame", "what"), rows)
    spec = actions.of_task(bundle.task, bundle.robot)
    orders = {
        "joints": episodes.joint_names,
        "numbers of an action": spec.names if spec.names != episodes.joint_names else (),
        "objects": episodes.object_names,
        "joints of the objects": episodes.displacement_names,
        "goal": bundle.task.goal.names,
        "fingertips": episodes.tip_names,
    }
    yield ""
    yield "Frame `base` is the robot's base. Quaternions are w x y z."
    yield from form.notes
    yield "Order of the numbers:"
    yield ""
    for what, names in orders.items():
        if names:
            yield f"* {what}: {', '.join(f'`{name}`' for name in names)}"


def _pictures(camera: Camera, form: Form) -> Iterator[tuple[str, ...]]:
    """Rows of a camera's picture and depth."""
    if camera.film is None:
        return
    size, when = f"{camera.film.height} x {camera.film.width}", "before the action of its step"
    place = form.place(BY_NAME["rgb"]).format(camera.name)
    yield f"`{place}`", f"{size} x 3", "sRGB 0..255", "", f"picture of camera `{camera.name}`, {when}"
    if camera.has_depth:
        place = form.place(BY_NAME["depth"]).format(camera.name)
        about = f"distance along the axis of camera `{camera.name}`, 0 where nothing was measured"
        yield f"`{place}`", size, form.depth_unit, "", about


def _about(bundle: TaskBundle, declared: Declared) -> tuple[str, str, str]:
    """Unit, frame and meaning of a term; those of actions depend on their kind."""
    if declared.name == "action":
        meaning, unit = actions.ABOUT[bundle.task.action]
        return unit, "", f"{meaning}: the label to learn from"
    return declared.unit, declared.frame, declared.about


def _cameras(bundle: TaskBundle, seen: Sequence[Camera]) -> Iterator[str]:
    filmed = [(each, each.film) for each in seen if each.film is not None]
    yield from ("## Camera" if len(filmed) < 2 else "## Cameras", "")
    if not filmed:
        yield "There are no pictures."
    for number, (each, film) in enumerate(filmed):
        yield from ([""] if number else [])
        if each.view is None:
            yield f"`{each.name}`, {film.width} x {film.height} px; its place was not given."
        else:
            yield from _camera(bundle, each.name, each.view)


def _camera(bundle: TaskBundle, name: str, view: View) -> Iterator[str]:
    k, pose = view.camera, (bundle.base_pose.inverse() @ view.camera_pose).matrix
    yield f"`{name}`, {k.width} x {k.height} px, OpenCV axes and integer pixel centres:"
    yield f"fx {k.fx:.2f}, fy {k.fy:.2f}, cx {k.cx:.2f}, cy {k.cy:.2f} px."
    place = ", ".join(f"{value:.3f}" for value in pose[:3, 3])
    axis = ", ".join(f"{value:.3f}" for value in pose[:3, 2])
    yield f"In the robot's base it stands at ({place}) m and looks along ({axis})."


def _origin(bundle: TaskBundle, options: FormOptions) -> Iterator[str]:
    """Sources and licences of the data, the robot and the objects."""
    yield from ("## Sources and licences", "")
    yield f"* Data: {options.licence or 'no licence is stated'}."
    yield f"* Robot: {bundle.robot.source or 'of unknown source'}. {_licences(bundle.robot.model.files)}"
    what = f"* Objects ({listing(bundle.objects, most=20)})"
    if bundle.kind == "twin":
        yield f"{what}: shapes and textures were built from the capture of the twin, whose terms apply to its pictures."
    else:
        yield f"{what}: shapes of the simulated world. {_licences(bundle.model.files)}"


def _licences(files: dict[str, bytes]) -> str:
    """The licence files of a model with their first lines."""
    found = [
        name
        for name in sorted(files)
        if name.startswith("licences/") or stated({PurePosixPath(name).name: files[name]})
    ]
    said = [f"`{PurePosixPath(name).name}`: {_first_line(files[name])}" for name in found]
    return f"Licences of its files: {'; '.join(said)}." if said else "Its files hold no licence of others."


def _first_line(text: bytes) -> str:
    lines = (line.strip(" #*\t") for line in text.decode(errors="replace").splitlines())
    return next((line for line in lines if line), "empty")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = (head, ["---"] * len(head), *rows)
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]


def _plural(count: int, word: str) -> str:
    return f"{count:,} {word}{'' if count == 1 else 's'}"
