"""Every verb through the real `dxb`, in a project of its own."""

from __future__ import annotations

import re
import shlex

import pytest

from dextera_build.cli import streams
from dextera_build.cli.build import check
from dextera_build.project.project import Project, find
from dextera_build.session import Session
from tests.e2e.space import Space
from tests.e2e.test_bad_captures import write_capture


@pytest.fixture
def built(space):
    assert space.build("say/words").code == 0
    return space


def test_a_build_ends_with_the_commands_that_show_its_result(space):
    assert "\n  show: dxb show say/words:all      report: dxb report\n" in space.dxb("build", "say/words").err
    assert "report:" not in space.dxb("build", "say/words").err  # nothing ran
    space.edit("recipes/say/words.yaml", "one two", "one")
    wanted = "say/words:word[one].loud"
    assert f"  show: dxb show '{wanted}'" in space.dxb("build", wanted).err


def test_plan_tells_what_would_run(space):
    rows = [line.split("\t") for line in space.dxb("plan", "say/words").out.splitlines()]
    assert [row[:2] for row in rows if row[0] == "start"] == [["start", "stale"]]
    assert {row[1] for row in rows if row[0] != "start"} == {"unknown"}
    space.build("say/words")
    rows = space.dxb("plan", "--json", "say/words").rows
    assert {row["status"] for row in rows} == {"cached"}


def test_plan_ends_with_a_sum(space):
    assert space.dxb("plan", "say/words").err.startswith("1 of 5 nodes would run, 4 may follow\n")
    space.build("say/words")
    assert space.dxb("plan", "say/words").err == "7 nodes, all up to date\n"
    space.edit("recipes/say/words.yaml", "times: 2", "times: 3")
    assert re.fullmatch(r"2 of 7 nodes would run, 1 may follow, about [0-9.]+ s\n", space.dxb("plan", "say/words").err)


def test_get_and_report_answer_in_json(asked):
    (path,) = asked.dxb("get", "say/words:all", "--json", "-o", "got").document["files"]
    assert (asked.root / path).is_file()
    assert (asked.root / asked.dxb("report", "--json").document["report"]).is_file()


@pytest.mark.medium
def test_ls(asked):
    assert "say/words\tWords, louder." in asked.dxb("ls").out
    assert "toy.start\tReturn the text." in asked.dxb("ls", "rules").out
    assert "toy.spoken\tcloud\tcloud\tno: no-such-distribution" in asked.dxb("ls", "backends").out
    assert "say/words:word[one].loud\tcached\ttoy.shout\t-\t" in asked.dxb("ls", "say/words").out
    (run,) = asked.dxb("ls", "--json", "runs").rows
    assert (run["run"], run["recipe"], run["ended"]) == ("0001", "say/words", "done")


def test_show_a_node_and_the_configuration(asked):
    shown = asked.dxb("show", "--json", "say/words:word[one].loud").document
    assert (shown["rule"], shown["version"], shown["backend"]) == ("toy.shout", 1, None)
    assert shown["type"] == "File"
    assert shown["options"]["times"] == 1
    config = asked.dxb("show", "--config", env={"DXB_JOBS": "3"}).out
    assert "jobs\t3\tenvironment" in config
    assert "cache\tcache\tdxb.toml" in config
    assert "profile\tcpu\tdefault" in config
    assert "durable\ttrue\tdefault" in asked.dxb("show", "--config", env={"DXB_DURABLE": ""}).out
    config = asked.dxb("show", "--config", "--json", env={"DXB_JOBS": "3"}).rows
    assert {"setting": "jobs", "value": 3, "origin": "environment"} in config
    past = {row["node"]: row["run"] for row in asked.dxb("show", "--json", "say/words").rows}
    assert past["start"] == "0001"


def test_get_writes_the_artifact(asked):
    answer = asked.dxb("get", "say/words:all", "-o", "there")
    assert (asked.root / answer.out.strip()).read_bytes() == b"ONE!!! TWO!!!"


def test_a_node_that_another_recipe_built_can_be_read(space):
    space.write("recipes/say/use.yaml", "inputs: {t: say/words:word.loud}\nnodes: {a: {rule: toy.join, texts: $t}}")
    assert space.build("say/use").code == 0
    assert "result\t" in space.dxb("show", "say/words:word[one].loud").out
    (path,) = space.dxb("get", "say/words:word[one].loud", "-o", "there").out.split()
    assert (space.root / path).read_bytes() == b"ONE!"
    assert space.dxb("get", "say/use:say/words:word[two].loud", "-o", "there").code == 0
    answer = space.dxb("get", "say/words:all")
    assert (answer.code, answer.out) == (2, "")  # nobody built it


def test_get_takes_a_name_with_a_suffix_for_a_file(asked):
    answer = asked.dxb("get", "say/words:all", "-o", "there/all.txt")
    assert (asked.root / answer.out.strip()).read_bytes() == b"ONE!!! TWO!!!"
    assert answer.out == "there/all.txt\n"
    assert asked.dxb("get", "say/words:all", "-o", "there.v2/").out == "there.v2/all\n"
    wrong = asked.dxb("get", "say/words:words", "-o", "words.usdz")
    assert (wrong.code, wrong.out) == (2, "")
    assert "error[DXB-U220]: Collection cannot be written as `words.usdz`" in wrong.err


def test_what_was_never_built_and_what_is_empty_is_said(space):
    answer = space.dxb("show", "say/words")
    assert (answer.code, answer.out) == (0, "")
    assert answer.err.startswith(
        "`say/words` was never built here; `dxb plan say/words` says what a build of it would run\n"
    )
    for words, told in ((("ls", "runs"), "there are no runs here"), (("library", "mug"), "no asset fits")):
        answer = space.dxb(*words)
        assert (answer.code, answer.out, told in answer.err) == (0, "", True)
    assert space.dxb("show", "say/words", "--json").rows == []


def test_a_broken_recipe_hides_no_other(space):
    space.write("recipes/say/broken.yaml", "nodes: [\n")
    answer = space.dxb("ls")
    assert answer.code == 2
    assert "say/words\tWords, louder.\n" in answer.out
    assert ("recipes/say/broken.yaml" in answer.err, answer.err.count("error[")) == (True, 1)


def test_nothing_is_built_before_every_recipe_and_target_is_known(space):
    space.write("recipes/say/too.yaml", "nodes: {a: {rule: toy.start}}\n")
    for wrong, code in (("say/nothing", "U108"), ("say/too:b", "U110")):
        answer = space.build("say/words", wrong)
        assert (answer.code, f"error[DXB-{code}]" in answer.err, answer.nodes("ran")) == (2, True, set())


def test_a_node_that_the_recipe_does_not_have_is_not_proposed(asked):
    for verb in ("get", "check", "show"):
        answer = asked.dxb(verb, "say/words:nope")
        assert (answer.code, "error[DXB-U110]: `say/words` has no node `nope`" in answer.err) == (2, True)


def test_flags_that_change_nothing_are_refused(asked):
    for words in (
        ("show", "say/words:all", "-o", "f.txt"),
        ("show", "say/words", "--by", "rule"),
        ("show", "say/words", "--dot"),
        ("show", "say/words", "--graph", "-o", "g.png"),
        ("show", "say/words", "--graph", "--dot", "-o", "g.svg"),
        ("ls", "--deps"),
        ("ls", "runs", "--stale"),
    ):
        answer = asked.dxb(*words)
        assert (answer.code, answer.out, "error[DXB-U215]" in answer.err) == (2, "", True), words
    assert asked.dxb("show", "say/words", "--graph", "--by", "rule", "-o", "g.svg").out == "g.svg\n"


def test_a_name_like_that_of_a_rule_is_told(asked):
    for text, rule in (("toy.shuot", "toy.shout"), ("shout", "toy.shout"), ("Shout", "toy.shout")):
        assert f"hint: did you mean `{rule}`?" in asked.dxb("show", text).err
    assert "the nearest" not in asked.dxb("show", "nix").err


def test_new_files_come_with_the_next_step(space):
    assert "dxb build toy/scene --input capture=FOLDER" in space.dxb("new", "recipe", "toy/scene").err
    assert "`NODE: {rule: toy.bright, image: $...}`" in space.dxb("new", "rule", "toy.bright").err
    assert "hint: `dxb new backend toy.bright=fast`" in space.dxb("new", "backend", "toy.bright", "fast").err
    assert "dxb build RECIPE --backend toy.bright=fast" in space.dxb("new", "backend", "toy.bright=fast").err


def test_runs_are_those_of_this_project(space, tmp_path_factory):
    shared = {"DXB_CACHE": str(tmp_path_factory.mktemp("shared"))}
    other = Space(tmp_path_factory.mktemp("other"))
    other.write("dxb.toml", "")
    assert space.dxb("build", "say/words:start", env=shared).code == 0
    assert space.dxb("ls", "runs", env=shared).out.startswith("0001\t")
    assert other.dxb("ls", "runs", env=shared).out == ""


def test_nodes_are_listed_in_the_order_of_a_build(space):
    listed = [line.split("\t")[0].partition(":")[2] for line in space.dxb("ls", "say/words").out.splitlines()]
    planned = [line.split("\t")[0] for line in space.dxb("plan", "say/words").out.splitlines()]
    assert listed == planned


def test_a_scene_that_cannot_be_written_is_refused_before_anything_is_built(space):
    answer = space.dxb("new", "scene", "twin/tabletop", "-o", "dxb.toml/scene.yaml")
    assert (answer.code, "error[DXB-U177]: `dxb.toml/scene.yaml` cannot be written" in answer.err) == (2, True)


def test_an_output_that_cannot_be_written_is_not_taken_for_the_store(asked):
    for words in (("bundle", "create", "say/words", "-o", "dxb.toml/w.tar"), ("bundle", "keygen", "dxb.toml/anna")):
        answer = asked.dxb(*words)
        assert (answer.code, f"error[DXB-U177]: `{words[-1]}` cannot be written: " in answer.err) == (2, True), (
            answer.err
        )


def test_get_of_what_was_never_built_says_how(space):
    answer = space.dxb("get", "say/words:all")
    assert answer.code == 2
    assert "hint: `dxb build 'say/words:all'`" in answer.err


def test_log_of_a_run(asked):
    rows = dict(line.split("\t")[:2] for line in asked.dxb("log").out.splitlines())
    assert rows["start"] == "ran"
    assert asked.dxb("log", "say/nothing").code == 2


def test_report_is_one_file(asked):
    path = asked.root / asked.dxb("report").out.strip()
    text = path.read_text()
    assert "say/words" in text
    assert "<script src" not in text


def test_init_new_and_check_make_a_project_that_builds(tmp_path, space):
    answer = space.dxb("init", "fresh")
    assert answer.code == 0
    assert "fresh/dxb.toml" in answer.out.splitlines()
    assert space.dxb("init", "fresh").code == 2
    space.root = space.root / "fresh"
    assert space.dxb("new", "rule", "toy.bright").out.strip() == "rules/toy/bright.py"
    assert space.dxb("new", "rule", "toy.bright").code == 2
    assert space.dxb("new", "backend", "toy.bright=fast").out.strip() == "rules/toy/bright_fast.py"
    assert space.dxb("new", "recipe", "toy/scene").out.strip() == "recipes/toy/scene.yaml"
    assert space.dxb("new", "rule", "NotAName").code == 2
    assert "toy.bright" in space.dxb("ls", "rules").out
    (space.root / "capture").mkdir()
    assert "twin/fresh\tsound" in space.dxb("check", "twin/fresh").out


def test_check_without_a_recipe_checks_those_of_the_project_one_by_one(space, monkeypatch):
    answer = space.dxb("check")
    found = [line.partition("\t")[0] for line in answer.out.splitlines()]
    own = sorted(file.stem for file in (space.root / "recipes/say").glob("*.yaml"))
    assert answer.code == 0, answer.err
    assert sorted(found) == [f"say/{name}" for name in own]
    assert space.dxb("check", "--all", found[0]).code == 2
    project = find(space.root)
    assert check.recipes(project, bundled=False) == found
    everything = check.recipes(project, bundled=True)
    assert {*found, "twin/tabletop", "robot/panda"} < set(everything)

    space.write("recipes/say/aa.yaml", (space.root / f"recipes/{found[0]}.yaml").read_text())
    inner = Session.plan

    def plan(session, **options):
        if session.recipe == found[0]:
            raise streams.Terminated
        return inner(session, **options)

    monkeypatch.setattr(Session, "plan", plan)
    stopped = space.dxb("check")
    assert stopped.code == streams.TERMINATED
    assert stopped.out.startswith("say/aa\tsound")
    assert stopped.err == f"interrupted after 1 check of {len(found) + 1}\n"


def test_check_builds_a_node_again_and_compares(built):
    assert "same output again" in built.dxb("check", "say/words:word[one].loud").out
    built.write(
        "rules/toy/dice.py",
        '"""toy.dice: chance."""\nimport os\nfrom dextera_build.artifacts.base import File\n'
        "from dextera_build.rule import Context, rule\n\n@rule(version=1)\ndef dice(ctx: Context) -> File:\n"
        '    """Return chance."""\n    return File(data=os.urandom(8))\n',
    )
    built.write("recipes/say/dice.yaml", "nodes: {d: {rule: toy.dice}}")
    assert built.build("say/dice").code == 0
    answer = built.dxb("check", "say/dice:d")
    assert answer.code == 1
    assert "is not deterministic" in answer.err


def test_cache_size_counts(asked):
    rows = {line.split("\t")[0]: line.split("\t")[1:] for line in asked.dxb("cache", "size").out.splitlines()}
    assert int(rows["actions"][0]) == 7
    assert int(rows["blobs"][1]) > 0


@pytest.mark.medium
def test_doctor_lists_findings(space):
    answer = space.dxb("doctor", "--json")
    assert answer.code in (0, 4)
    found = {finding["what"]: finding for finding in answer.rows}
    assert {"python", "store", "rendering"} <= set(found)


def test_a_new_backend_has_the_functions_of_its_rule(space):
    assert space.dxb("new", "backend", "toy.shout=softly").out == "rules/toy/shout_softly.py\n"
    assert space.dxb("new", "backend", "simulate.settle=hopeful").out == (
        "rules/simulate/settle_hopeful.py\ntests/test_simulate_settle_hopeful.py\n"
    )
    text = (space.root / "rules/simulate/settle_hopeful.py").read_text()
    assert "def let_go(ctx: Context, scene: Scene, common: Any, options: HopefulOptions) -> SettleReport:" in text
    found = Project(space.root).library.find("simulate.settle").backends["hopeful"]
    assert found.options is not None
    assert list(found.options.model_fields) == ["seed"]


def test_a_variable_that_nothing_reads_is_told_once_a_command(built):
    answer = built.dxb("build", "say/words", env={"DXB_KACHE": "elsewhere"})
    assert answer.code == 0
    assert "warning: nothing reads the variable `DXB_KACHE`; did you mean `DXB_CACHE`?\n" in answer.err
    assert answer.err.count("DXB_KACHE") == 1
    assert "warning" not in built.dxb("ls", env={"DXB_JOBS": "2", "DXB_KEY_PASSPHRASE": "x"}).err


@pytest.mark.parametrize(
    ("flag", "value", "code"),
    [
        ("--jobs", "many", "DXB-U103"),
        ("--console", "liv", "DXB-U103"),
        ("--executor", "rai", "DXB-U103"),
        ("--calls", "replai", "DXB-U103"),
        ("--cache", "local:rw,nowhere:r", "DXB-U133"),
        ("--cache", "local:x", "hint: `local:r` reads from it"),
    ],
)
def test_a_wrong_setting_is_refused_where_nothing_has_to_run(asked, flag, value, code):
    answer = asked.dxb("build", "say/words", flag, value)
    assert (answer.code, answer.out, code in answer.err) == (2, "", True)


def test_one_node_is_no_plural(space):
    for said in ("1 node: 1 ran", "up to date   1 node   ", "up to date   1 node   "):
        assert said in space.dxb("build", "say/words:start").err


def test_a_file_in_place_of_the_store_is_one_error(space):
    space.write("cache", "")
    answer = space.dxb("build", "say/words")
    assert (answer.code, answer.err.count("error[")) == (1, 1)
    assert "error[DXB-S102]: a file is in the place of a folder of the store" in answer.err
    assert str(space.root / "cache") in answer.err


def test_a_wrong_setting_is_named(space):
    space.write("dxb.toml", 'chache = "x"\n')
    answer = space.dxb("show", "--config")
    assert answer.code == 2
    assert "did you mean `cache`?" in answer.err
    space.write("dxb.toml", 'profile = "fast"\n')
    assert "`profile` cannot be `fast`" in space.dxb("show", "--config").err


def test_what_init_suggests_is_understood(tmp_path):
    """The command in the comment of the recipe that `dxb init` writes."""
    space = Space(tmp_path)
    write_capture(tmp_path / "shot")
    (recipe,) = (line for line in space.dxb("init", ".").out.splitlines() if "recipes" in line)
    text = (tmp_path / recipe).read_text()
    (command,) = (line.removeprefix("#   dxb ") for line in text.splitlines() if line.startswith("#   dxb "))
    answer = space.dxb(*shlex.split(command.replace("PATH", "shot").replace("build ", "plan ", 1)))
    assert answer.code == 0, answer.err


def test_a_new_project_is_named_by_its_folder_and_says_what_to_do_next(tmp_path):
    """A CI job needs only the printed command, also to lock and to compare."""
    space = Space(tmp_path)
    answer = space.dxb("init", "Lab-2/my desk")
    assert "Lab-2/my desk/recipes/twin/my_desk.yaml" in answer.out
    desk = tmp_path / "Lab-2" / "my desk"
    command = answer.err.splitlines()[-1].strip()
    assert command == "cd 'Lab-2/my desk' && dxb build twin/my_desk"
    there = Space(desk)
    missing = there.dxb("plan", "twin/my_desk")
    assert missing.code == 2
    assert "capture" in missing.err
    write_capture(desk / "capture")
    assert there.dxb("plan", "twin/my_desk").code == 0
