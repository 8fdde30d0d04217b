"""evaluate.attempted and demonstrate.recorded: what a robot did, judged from what was measured, and by the operator."""

from __future__ import annotations

import io
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.base import Collection, File, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.task import View
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.deploying.faults import Fault
from dextera_build.deploying.simulated import Simulation
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.formats.ros import reading
from dextera_build.policy import robot_run
from dextera_build.testing import RuleRunner
from tests import factories, task_bundles
from tests.deploying import robots
from tests.policy import policies

BUNDLE = task_bundles.lift()
RAISED_OPEN = np.array([0.3, 0.1, 0.16, 0.05, 0.05])


@cache
def lifted(operator: bool | None = None) -> bytes:
    """A run in which the box is lifted."""
    return robots.recording(robots.Lifting(), operator=operator, world="real")


@cache
def missed(operator: bool | None = None) -> bytes:
    """A run in which the hand rises without it."""
    places = (robots.OVER, robots.AROUND, RAISED_OPEN)
    return robots.recording(robots.Lifting(places), operator=operator, limit_s=6.0, world="real")


def trials(tmp_path: Path, runs: dict[str, bytes]) -> Trials:
    made = RuleRunner(tmp_path).run("evaluate.attempted", bundle=BUNDLE, runs=Folder(files=runs))
    assert isinstance(made, Trials)
    return made


@pytest.mark.medium
def test_success_is_that_of_the_measurements(tmp_path: Path) -> None:
    made = trials(tmp_path, {"a.mcap": lifted(), "b.mcap": missed(), "notes.txt": b"-"})
    assert (made.world, made.poses, made.algorithm, made.label, made.source) == (
        "real", "tracked", "line", "LINE", "0" * 64,
    )  # fmt: skip
    assert [trial.success for trial in made.items] == [True, False]
    assert [trial.verdicts and trial.verdicts.operator for trial in made.items] == [None, None]
    assert made.items[0].stage == len(made.stages)
    assert made.items[1].reason
    assert made.placed[0, 0, :2] == pytest.approx(task_bundles.BOX_M, abs=2e-3)


@pytest.mark.medium
def test_the_operator_overrules_and_both_verdicts_are_kept(tmp_path: Path) -> None:
    made = trials(tmp_path, {"a.mcap": lifted(operator=False), "b.mcap": missed(operator=True)})
    assert [trial.success for trial in made.items] == [False, True]
    assert made.items[0].reason == "the operator saw that it failed"
    kept = [trial.verdicts for trial in made.items]
    assert [(each.measured, each.operator) for each in kept if each] == [(True, False), (False, True)]


@pytest.mark.medium
def test_where_objects_are_not_measured_the_operator_alone_judges(tmp_path: Path) -> None:
    def blind(operator: bool | None, seconds: float = 0.5) -> bytes:
        lost = Simulation(loss=0.0, faults=(Fault("poses_stop", at_s=0.2),))
        more = {"needed": (), "operator": operator, "limit_s": seconds, "world": "real", "simulation": lost}
        return robots.recording(robots.Lifting((robots.OVER,)), **more)

    runs = {"a.mcap": blind(True, 1.0), "b.mcap": blind(False, 1.1), "c.mcap": blind(None, 1.2)}
    made = trials(tmp_path, runs)
    assert [trial.success for trial in made.items] == [True, False]
    assert made.items[1].reason == "the operator saw that it failed"
    assert [trial.verdicts for trial in made.items] == [None, None], "nothing was judged from measurements"
    assert made.excluded == {"the objects were not measured at all times": 1}
    assert made.placed[0, 0, :2] == pytest.approx(task_bundles.BOX_M, abs=2e-3)
    assert made.examples.items == made.examples.failures == {}, "their objects are not known"
    with pytest.raises(RuleError, match="none of 3 recordings"):
        RuleRunner(tmp_path).run("demonstrate.recorded", bundle=BUNDLE, runs=Folder(files=runs))


def test_episodes_are_what_was_measured_and_sent(tmp_path: Path) -> None:
    rig = RuleRunner(tmp_path)
    made = rig.run("demonstrate.recorded", bundle=BUNDLE, runs=Folder(files={"a.mcap": lifted(), "b.mcap": missed()}))
    assert isinstance(made, Episodes)
    assert (made.world, list(made.items), list(made.failures), made.attempts) == ("real", ["a"], ["b"], 2)
    episode = made.items["a"]
    assert episode.origin == "policy"
    assert np.abs(episode.joints[-1] - robots.UP).max() < 0.02
    assert np.abs(episode.executed - episode.action).max() > 0.01  # the guard's ramp, at the beginning
    assert episode.objects[-1, 0, 2] - episode.objects[0, 0, 2] > 0.05
    assert episode.hand[-1, 0, 2] - episode.hand[0, 0, 2] == pytest.approx(
        episode.joints[-1, 2] - episode.joints[0, 2], abs=1e-5
    )
    sets = Collection(items={"robot": made, "again": made})
    mixed = rig.run("demonstrate.mixture", sets=sets, options={"weights": {"robot": 2}})
    assert isinstance(mixed, Mixture)
    assert mixed.parts["robot"].world == "real"


@pytest.mark.medium
def test_episodes_of_two_days_are_gathered_and_their_trials_are_no_pairs(tmp_path: Path) -> None:
    rig = RuleRunner(tmp_path)

    def run(day: str) -> bytes:
        return robots.recording(robots.Lifting((robots.OVER,)), operator=True, limit_s=0.5, world="real", day=day)

    days = {
        day: Folder(files={f"{day}_{number}.mcap": run(f"{day} {number}") for number in (1, 2)})
        for day in ("mon", "tue")
    }
    sets = {day: rig.run("demonstrate.recorded", bundle=BUNDLE, runs=runs) for day, runs in days.items()}
    again = rig.run("demonstrate.recorded", bundle=BUNDLE, runs=Folder(files={"copy.mcap": run("mon 1")}))
    gathered = rig.run("demonstrate.gather", shards=Collection(items={**sets, "wed": again}))
    assert isinstance(gathered, Episodes)
    assert list(gathered.items) == ["mon_1", "mon_2", "tue_1", "tue_2"]
    assert list(gathered.failures) == ["copy"]
    tried = {
        day: rig.run("evaluate.attempted", bundle=BUNDLE, runs=runs, options={"label": day})
        for day, runs in days.items()
    }
    with pytest.raises(RuleError, match="no two sets of trials share a start"):
        rig.run("evaluate.paired", trials=Collection(items=tried))


@pytest.mark.medium
def test_a_demonstration_that_another_program_commands_is_an_episode(tmp_path: Path) -> None:
    rig = RuleRunner(tmp_path)
    recording = File(data=robots.demonstration())
    made = rig.run("demonstrate.recorded", bundle=BUNDLE, runs=recording)
    assert isinstance(made, Episodes)
    episode = made.items["run"]
    assert (made.world, episode.origin, episode.success) == ("real", "operator", True)
    assert np.array_equal(episode.action, episode.executed)
    assert np.abs(episode.joints[1:] - episode.action[:-1]).max() < 0.05  # the arm follows its commands
    assert np.ptp(episode.action[:, 2]) > 0.1
    with pytest.raises(RuleError, match="the recordings are demonstrations"):
        rig.run("evaluate.attempted", bundle=BUNDLE, runs=recording)


def test_joints_at_even_times_are_those_of_the_commands() -> None:
    shown = np.full((24, 32, 3), 90, np.uint8)
    slow = iter([0.0, 0.0, 0.0, 0.1, 0.0, 0.1, *[0.0] * 100])
    data = robots.recording(
        robots.Lifting((robots.OVER,)), limit_s=2.5, camera=shown, needed=("rgb",), thinks=lambda: next(slow)
    )
    run = robot_run.read(io.BytesIO(data), "run.mcap", BUNDLE)
    stream, stamps, places = io.BytesIO(data), list[int](), list[list[float]]()
    for time, _, message in reading.messages(stream, "run.mcap", ["/joint_states"]):
        stamps.append(reading.stamp(message, time))
        places.append(dict(zip(message.name, message.position, strict=True))["x"])
    truth = partial(np.interp, xp=stamps, fp=places)
    even = robot_run.evenly(run)
    given, joints = (np.array([each.joints[0] for each in of.measured]) for of in (run, even))
    assert np.abs(given - truth(run.times)).max() > 0.01, "the joints of a picture are older"
    assert joints[:-1] == pytest.approx(truth(even.times), abs=5e-4)  # straight lines over 150 ms
    assert (np.diff(even.times) == 50_000_000).all()
    # Two commands came 100 ms late: each of those before them lasted three periods.
    assert len(even.sent) == len(run.sent) + 4
    assert even.sent[1:4] == pytest.approx(np.tile(run.sent[1], (3, 1)))


def test_pictures_of_a_robot_become_a_film(tmp_path: Path) -> None:
    rig = RuleRunner(tmp_path)
    shown = np.tile(np.arange(32, dtype=np.uint8)[None, :, None] * 6, (24, 1, 3))
    run = robots.recording(robots.Lifting((robots.OVER,)), operator=True, limit_s=1.0, camera=shown)
    given = {"bundle": BUNDLE, "runs": Folder(files={"a.mcap": run})}
    episodes = rig.run("demonstrate.recorded", **given)
    view = View(
        camera=factories.camera(32, 24), camera_pose=factories.placed(factories.look_at((0.5, -0.5, 0.7)), "camera")
    )
    film = rig.run("demonstrate.robot_film", **given, episodes=episodes, view=view)
    assert isinstance(film, Film)
    frames = film.pixels("a")
    assert frames.shape == (20, 24, 32, 3)
    assert int(np.abs(frames.astype(int) - shown).max()) <= 6  # noise and JPEG
    assert len({frame.tobytes() for frame in frames}) > 1
    other = view.model_copy(update={"camera": factories.camera(64, 48)})
    with pytest.raises(RuleError, match="have 32 x 24 px, `view` has 64 x 48"):
        rig.run("demonstrate.robot_film", **given, episodes=episodes, view=other)
    blind = {"bundle": BUNDLE, "runs": Folder(files={"a.mcap": lifted()})}
    with pytest.raises(RuleError, match="the pictures of no camera"):
        rig.run("demonstrate.robot_film", **blind, episodes=rig.run("demonstrate.recorded", **blind), view=view)


def test_a_policy_that_knows_real_worlds_is_told_that_it_is_in_one() -> None:
    knows = policies.contract(BUNDLE, ("joints", "world"))
    assert robot_run.told(BUNDLE, knows).kind == "real"
    worlds = knows.inputs[1].model_copy(update={"names": ("twin", "reference"), "shape": (2,)})
    never = knows.model_copy(update={"inputs": (knows.inputs[0], worlds)})
    assert robot_run.told(BUNDLE, never).kind == "twin"


def test_a_robot_that_is_simulated_says_so(tmp_path: Path) -> None:
    data = robots.recording(robots.Lifting((robots.OVER,)), operator=True, limit_s=1.0)
    made = RuleRunner(tmp_path).run("evaluate.attempted", bundle=BUNDLE, runs=File(data=data))
    assert isinstance(made, Trials)
    assert made.world == "twin"


@pytest.mark.parametrize(
    ("about", "why"),
    [
        ({"task": "Other"}, "`b.mcap` is of another task"),
        ({"embodiment": "1"}, "`b.mcap` is of another robot"),
        ({"policy": "1"}, "the recordings differ in `policy`"),
    ],
)
def test_recordings_that_do_not_belong_together_are_refused(about, why, tmp_path: Path) -> None:
    other = robots.recording(robots.Lifting((robots.OVER,)), limit_s=0.5, world="real", **about)
    with pytest.raises(RuleError) as caught:
        trials(tmp_path, {"a.mcap": missed(), "b.mcap": other})
    assert why in str(caught.value)


def test_a_recording_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"`a\.mcap`"):
        trials(tmp_path, {"a.mcap": missed()[:50_000]})
    with pytest.raises(RuleError, match="holds no recording"):
        trials(tmp_path, {"notes.txt": b""})
