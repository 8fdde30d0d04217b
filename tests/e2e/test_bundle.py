"""`dxb bundle` from one project and store to another, through the real `dxb`."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.e2e.space import Space

RECIPE = """summary: A file, louder.
inputs:
  text: in/text.txt
nodes:
  loud: {rule: toy.shout, text: $text}
  words: {rule: toy.split, text: $loud}
  word:
    each: $words
    as: word
    nodes:
      louder: {rule: toy.shout, text: $word, times: 3}
  all: {rule: toy.join, texts: $word.louder}
targets:
  default: [all]
"""


@pytest.fixture
def there(space: Space, tmp_path_factory: pytest.TempPathFactory) -> Space:
    """A second project with the same recipes and rules, and a store of its own; the first has built."""
    space.write("recipes/say/file.yaml", RECIPE)
    space.write("in/text.txt", "some text\n")
    other = Space(tmp_path_factory.mktemp("there"))
    for name in (
        "dxb.toml",
        *(str(path.relative_to(space.root)) for path in space.root.rglob("*.*") if path.is_file()),
    ):
        other.write(name, (space.root / name).read_text())
    assert space.build("say/file").code == 0
    return other


def bundle(space: Space, *more: str, name: str = "words.tar") -> str:
    done = space.dxb("bundle", "create", "say/file", "-o", name, *more)
    assert done.code == 0, done.err
    return str(space.root / name)


def test_a_result_goes_to_another_project(space, there):
    file = bundle(space)
    done = there.dxb("bundle", "import", file)
    assert done.code == 0, done.err
    assert done.out.split("\t")[0] == "say/file:all"
    assert "6 nodes: 6 results new (5 without their bytes), 0 known" in done.err
    assert "not signed" in done.err
    assert "not signed by a trusted key" in done.err
    assert there.dxb("get", "say/file:all", "-o", "got").code == 0
    assert (there.root / "got" / "all").read_bytes() == (space.root / "cache/out/say/file/all/all").read_bytes()
    wrong = there.dxb("get", "say/file:loud")
    assert (wrong.code, "is known, but its bytes are not in the store" in wrong.err) == (1, True)


@pytest.mark.medium
def test_a_build_after_an_import_runs_nothing(space, there):
    there.dxb("bundle", "import", bundle(space))
    rows = [line.split("\t")[:2] for line in there.dxb("plan", "say/file").out.splitlines()]
    assert {status for name, status in rows if name != "all"} == {"bare"}
    assert ["all", "cached"] in rows
    assert there.dxb("build", "--check", "say/file").code == 0
    built = there.build("say/file")
    assert len(built.nodes("cached")) == 6
    assert built.nodes("ran") == set()
    assert (there.root / "cache/out/say/file/all/all").read_text() == "!!!! SOME!!! TEXT!!!"
    there.dxb("build", "say/file")
    runs = there.dxb("ls", "runs").out
    assert "is up to date" in there.dxb("build", "say/file").err
    assert there.dxb("ls", "runs").out == runs  # nothing was even planned
    assert there.dxb("cache", "verify").code == 0
    swept = there.dxb("cache", "gc", "--yes", "--max-size", "1kB")
    assert swept.code == 0, swept.err
    assert there.build("say/file").nodes("ran") == set()


@pytest.mark.slow
def test_bytes_that_did_not_come_are_made_when_they_are_asked_for(space, there):
    there.dxb("bundle", "import", bundle(space))
    why = there.dxb("why", "say/file:loud").out
    assert "bare: key" in why
    assert "its bytes are not in the store" in why
    assert (
        "loud\tits result is bare: its bytes are not in the store" in there.dxb("plan", "--check", "say/file:loud").out
    )
    wrong = there.dxb("check", "say/file:all")
    assert (wrong.code, "DXB-B403" in wrong.err, "dxb build --whole 'say/file:all'" in wrong.err) == (1, True, True)
    built = there.dxb("build", "--console", "plain", "say/file:loud")
    assert built.code == 0, built.err
    line = "loud: its result is bare (bytes not in the store), and its bytes are requested"
    assert sum(line in row for row in built.err.splitlines()) == 1
    assert "1 ran" in built.err
    assert there.dxb("get", "say/file:loud").code == 0
    again = there.build("say/file:loud")
    assert again.nodes("ran") == set()
    there.edit("recipes/say/file.yaml", "times: 3", "times: 4")
    # What is read is made first; `loud` already exists.
    louder = {f"word[{word}].louder" for word in ("!", "SOME", "TEXT")}
    assert there.build("say/file").nodes("ran") == {"words", "all", *louder}
    assert there.dxb("check", "say/file:words").code == 0


def test_bytes_of_all_nodes_on_request(space, there):
    there.dxb("bundle", "import", bundle(space))
    assert there.build("say/file").nodes("ran") == set()
    wrong = there.dxb("bundle", "create", "say/file", "--closure", "full", "-o", "x.tar")
    assert (wrong.code, "`dxb build --whole say/file`" in wrong.err) == (2, True)
    assert len(there.build("--whole", "say/file").nodes("ran")) == 5
    assert there.dxb("bundle", "create", "say/file", "--closure", "full", "-o", "x.tar").code == 0
    assert there.build("--whole", "say/file").nodes("ran") == set()


def test_a_full_bundle_leaves_nothing_to_build(space, there):
    there.dxb("bundle", "import", bundle(space, "--closure", "full"))
    built = there.build("say/file")
    assert built.nodes("ran") == set()
    assert len(built.nodes("cached")) == 6
    there.write("in/text.txt", "some other text\n")
    built = there.build("say/file")
    assert "loud" in built.nodes("ran")
    assert "word[SOME].louder" in built.nodes("cached")


def test_an_imported_result_is_explained_as_the_one_that_was_built(space, there):
    there.dxb("bundle", "import", bundle(space))
    here, elsewhere = (project.dxb("show", "--lineage", "say/file:all") for project in (space, there))
    told = [line for line in here.out.splitlines() if "in/text.txt" in line]
    assert len(told) == 1
    assert told[0] in elsewhere.out
    for name in ("word[SOME].louder", "loud\ttoy.shout version 1", "option times"):
        assert name in elsewhere.out
    assert "does not know where it came from" not in elsewhere.out
    there.write("in/text.txt", "other")
    assert "in/text.txt" in there.dxb("why", "say/file:loud").out
    assert there.dxb("ls", "runs").out.count("say/file") == 1


def test_equal_targets_give_equal_bytes(space, there):
    one = Path(bundle(space, name="one.tar")).read_bytes()
    assert space.build("say/file").code == 0
    assert Path(bundle(space, name="two.tar")).read_bytes() == one
    done = space.dxb("bundle", "create", "say/file", "-o", "then.tar", env={"SOURCE_DATE_EPOCH": "0"})
    assert done.code == 0
    assert "created\t1970-01-01T00:00:00Z" in space.dxb("bundle", "inspect", "then.tar").out
    wrong = space.dxb("bundle", "create", "say/file", "-o", "then.tar", env={"SOURCE_DATE_EPOCH": "now"})
    assert (wrong.code, "DXB-U145" in wrong.err) == (2, True)


def test_whoever_imported_a_bundle_makes_the_same_one_when_the_time_is_said(space, there):
    epoch = {"SOURCE_DATE_EPOCH": "0"}
    assert there.dxb("bundle", "import", bundle(space)).code == 0
    digests = {
        where.dxb("bundle", "create", "say/file", "-o", "then.tar", env=epoch).out.split("\t")[1]
        for where in (space, there)
    }
    assert len(digests) == 1


def test_inspect_says_what_is_inside(space, there):
    file = bundle(space)
    rows = dict(line.split("\t", 1) for line in there.dxb("bundle", "inspect", file).out.splitlines())
    assert rows["target"] == "say/file:all"
    assert rows["nodes"] == "6"
    assert (rows["results"], rows["with bytes"]) == ("6", "1")
    assert rows["inputs"] == "1"
    assert rows["signature"] == "not signed"
    assert there.dxb("bundle", "inspect", file, "--recipe", "say/file").out == RECIPE
    wrong = there.dxb("bundle", "inspect", file, "--recipe", "say/fil")
    assert (wrong.code, "DXB-U148" in wrong.err, "did you mean `say/file`?" in wrong.err) == (2, True, True)
    raw = there.dxb("bundle", "inspect", file, "--json").document
    nodes = raw["config"]["builds"][0]["nodes"]
    assert {node["rule"] for node in nodes} == {"toy.join", "toy.shout", "toy.split"}
    assert {path for node in nodes for path in node["files"].values()} == {"in/text.txt"}


def test_only_who_is_trusted_is_believed(space, there):
    assert space.dxb("bundle", "keygen", "anna", "--name", "anna@lab").code == 0
    file = bundle(space, "--sign", "anna")
    wrong = there.dxb("bundle", "import", "--require-signed", file)
    assert (wrong.code, "DXB-S309" in wrong.err, "not trusted here" in wrong.err) == (1, True, True)
    folder = f"{there.root}/.config/dxb/trusted_keys"
    assert f"hint: if you trust the signer: `mkdir -p {folder} && cp SIGNER.pub {folder}/`" in wrong.err
    unsigned = there.dxb("bundle", "import", "--require-signed", bundle(space, name="unsigned.tar"))
    assert (unsigned.code, "is not signed" in unsigned.err, "--sign KEY" in unsigned.err) == (1, True, True)
    assert "say/file" not in there.dxb("ls", "runs").out
    there.write("trusted/anna.pub", (space.root / "anna.pub").read_text())
    there.write("dxb.toml", 'cache = "cache"\ntrusted_keys = "trusted"\nrequire_signed = true\n')
    done = there.dxb("bundle", "import", file)
    assert (done.code, "signed by anna@lab (SHA256:" in done.err) == (0, True)
    assert "not signed by a trusted key" not in done.err
    wrong = there.dxb("bundle", "import", bundle(space, name="unsigned.tar"))
    assert (wrong.code, "is not signed" in wrong.err, "anna@lab" in wrong.err) == (1, True, True)
    there.write("dxb.toml", 'trusted_keys = ["trusted", "nowhere"]\n')
    wrong = there.dxb("bundle", "import", file)
    assert (wrong.code, "DXB-U149" in wrong.err, "nowhere" in wrong.err) == (2, True, True)


def test_the_keys_of_the_user_count(space, there):
    space.dxb("bundle", "keygen", "anna")
    file = bundle(space, "--sign", "anna")
    there.write(".config/dxb/trusted_keys/anna.pub", (space.root / "anna.pub").read_text())
    assert there.dxb("bundle", "import", "--require-signed", file).code == 0


def test_what_is_not_built_is_not_bundled(space, there):
    space.edit("recipes/say/file.yaml", "times: 3", "times: 4")
    wrong = space.dxb("bundle", "create", "say/file", "-o", "x.tar")
    assert (wrong.code, "DXB-U142" in wrong.err, "`dxb build say/file`" in wrong.err) == (2, True, True)
    assert not (space.root / "x.tar").exists()


def test_a_blob_that_was_damaged_here_is_not_bundled(space, there):
    found = space.dxb("show", "--json", "say/file:all").document
    blob = space.root / "cache" / "cas" / found["output"][:2] / found["output"][2:]
    good = blob.read_bytes()
    os.chmod(blob, 0o644)
    blob.write_bytes(good[:-1] + b"?")
    wrong = space.dxb("bundle", "create", "say/file", "-o", "x.tar")
    assert (wrong.code, "damaged" in wrong.err) == (1, True)
    assert not (space.root / "x.tar").exists()


def test_words_that_are_wrong_are_explained(space, there):
    for words, code in (
        (("create", "say/file", "-o", "x.zip"), "DXB-U140"),
        (("create", "say/file", "-o", "in"), "DXB-U140"),
        (("create", "say/nothing", "-o", "x.tar"), "DXB-U108"),
        (("create", "say/file:nothing", "-o", "x.tar"), "DXB-U110"),
        (("create", "say/file", "-o", "x.tar", "--sign", "nothing"), "DXB-U144"),
        (("import", "nothing.tar"), "DXB-U146"),
        (("import", "dxb.toml"), "DXB-S301"),
        (("inspect", "in"), "DXB-S301"),
        (("import", "docker://localhost/x:v1"), "DXB-U147"),
    ):
        wrong = space.dxb("bundle", *words)
        assert code in wrong.err, (words, wrong.err)
        assert "Traceback" not in wrong.err
        assert wrong.code in (1, 2)


def test_a_damaged_bundle_leaves_no_result_behind(space, there):
    file = Path(bundle(space, "--closure", "full"))
    data = file.read_bytes()
    place = data.index(b"!!!! SOME!!! TEXT!!!")  # a blob, and no byte that nothing rests on
    file.write_bytes(data[:place] + b"?" + data[place + 1 :])
    wrong = there.dxb("bundle", "import", str(file))
    assert wrong.code == 1
    assert "DXB-S30" in wrong.err
    assert list((there.root / "cache").glob("ac/*/*")) == []
    assert there.dxb("ls", "runs").out.strip() == ""


def test_several_targets_in_one_bundle(space, there):
    assert space.build("say/words").code == 0
    done = space.dxb("bundle", "create", "say/words:word.loud", "say/file", "say/words:start", "-o", "both.tar")
    assert done.code == 0, done.err
    out = there.dxb("bundle", "import", str(space.root / "both.tar")).out.splitlines()
    names = [line.split("\t")[0] for line in out]
    assert names == ["say/file:all", "say/words:word[one].loud", "say/words:word[two].loud", "say/words:start"]
    assert there.dxb("get", "say/words:word[two].loud", "-o", "got").code == 0
