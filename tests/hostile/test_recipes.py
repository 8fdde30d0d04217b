"""Recipes that somebody made to do harm: refused with one short error, soon, and never a traceback."""

from __future__ import annotations

import os

import pytest

from tests.hostile.conftest import one_error

LONG = "z" * 300_000


def nodes(body: str) -> str:
    return f"nodes:\n  start: {{rule: toy.start}}\n{body}"


def shout(value: str) -> str:
    return nodes(f"  a: {{rule: toy.shout, text: $start, times: {value}}}\n")


def sweep(depth: int) -> str:
    """Matrices in matrices: a few lines say 9^depth copies."""
    steps = [
        "    " * n + f"  m{n}:\n" + "    " * n + f"    matrix: {{a: {list(range(9))}}}\n" + "    " * n + "    nodes:\n"
        for n in range(depth)
    ]
    return "nodes:\n" + "".join(steps) + "    " * depth + "  a: {rule: toy.start}\n"


RECIPES = {
    "a number of 5,000 digits": (shout("9" * 5000), "R102", "a number has more than 400 digits"),
    "a hexadecimal number of 50,000 digits": (shout("0x" + "f" * 50_000), "R102", "more than 400 digits"),
    "a number that is none": (shout("!!int x"), "R102", "the tag `tag:yaml.org,2002:int` is not known here"),
    "octal digits that are none": (shout("!!int 0o99"), "R102", "the tag `tag:yaml.org,2002:int` is not known here"),
    "infinity by a tag": (nodes("  a: {rule: toy.start, sizes_m: [!!float inf]}\n"), "R102", "is not known here"),
    "infinity by its size": (nodes("  a: {rule: toy.start, sizes_m: [1e999]}\n"), "R109", "finite"),
    "brackets": ("a: " + "[" * 200_000, "R101", "nested more than 100 deep"),
    "braces": ("{" * 100_000, "R102", "a key must be text"),
    "dashes": ("- " * 100_000, "R101", "nested more than 100 deep"),
    "blocks in blocks": ("".join(" " * n + "a:\n" for n in range(1000)), "R101", "nested more than 100 deep"),
    "quotation marks": ("'" * 100_001, "R101", "not valid YAML"),
    "documents": ("---\n" * 100_000, "R101", "another document"),
    "a control character": ("summary: a\x1b[2Jb\nnodes: {}", "R101", "not valid YAML"),
    "a pair that is none": ('summary: "\\ud800"\nnodes: {}', "R101", "not valid YAML"),
    "a long key": (f"? {LONG}\n: 1\n", "R112", "a recipe has no `zzz"),
    "a long rule": (nodes(f"  a: {{rule: {LONG}}}\n"), "R201", "no rule is called `zzz"),
    "a long reference": (nodes(f"  a: {{rule: toy.shout, text: ${LONG}}}\n"), "R104", "names nothing"),
    "a rule that speaks to the terminal": (
        nodes('  a: {rule: "toy.\\e[2J\\u202e"}\n'),
        "R201",
        "`toy.\\x1b[2J\\u202e`",
    ),
    "a rule with a null byte": (nodes('  a: {rule: "toy.\\0start"}\n'), "R201", "`toy.\\x00start`"),
    "a rule by a path": (nodes("  a: {rule: ../../start}\n"), "R201", "no rule is called"),
    "a rule from the library": (nodes("  a: {rule: os.system}\n"), "R201", "no rule is called"),
    "a backend by a path": (nodes("  a: {rule: toy.spoken, text: $start, backend: ../x}\n"), "R202", "no backend"),
    "a backend that is a list": (nodes("  a: {rule: toy.spoken, text: $start, backend: [1]}\n"), "R112", "is text"),
    "a recipe above the project": (nodes("  a: {recipe: ../../etc/passwd}\n"), "R110", "no recipe"),
    "a recipe by two ways": (nodes("  a: {recipe: say/../say/words}\n"), "R110", "no recipe"),
    "a recipe of the machine": (nodes("  a: {recipe: /etc/passwd}\n"), "R110", "no recipe"),
    "a recipe with a long path": (nodes(f"  a: {{recipe: {'a/' * 3000}b}}\n"), "R110", "no recipe"),
    "a recipe that is a list": (nodes("  a: {recipe: [1]}\n"), "R112", "`recipe` is text, this is list"),
    "a base that is a list": ("extends: [say/words]", "R112", "`extends` is text, this is list"),
    "a base with a null byte": ('extends: "a\\0b"', "R110", "no recipe is called `a\\x00b`"),
    "an item that is no name": (nodes('  a: {each: $start, as: "x\\ny", nodes: {b: {rule: toy.start}}}\n'), "R112", ""),
    "a group over a table": (nodes("  a: {each: {x: 1}, nodes: {b: {rule: toy.start}}}\n"), "R112", "`each` is text"),
    "a file with a long name": (
        f"inputs: {{f: {'a' * 5000}}}\n" + nodes("  a: {rule: toy.split, text: $f}"),
        "R301",
        "",
    ),
    "a matrix of 9^5000": (
        f"nodes:\n  m:\n    matrix: {{{', '.join(f'a{n}: {list(range(9))}' for n in range(5000))}}}\n"
        "    nodes: {a: {rule: toy.start}}\n",
        "R506",
        "the matrix has more than 10^15 copies",
    ),
    "matrices in matrices": (sweep(6), "R506", "the matrix has 59,049 copies, 10,000 are allowed"),
    "a circle of 3,000": (
        "nodes:\n" + "".join(f"  a{n}: {{rule: toy.shout, text: $a{(n - 1) % 3000}}}\n" for n in range(3000)),
        "R108",
        "the recipe feeds into itself",
    ),
}


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_is_refused_with_one_short_error(project, dxb, name):
    text, code, words = RECIPES[name]
    (project.root / "recipes" / "x.yaml").write_bytes(text.encode(errors="surrogatepass"))
    said = one_error(dxb("check", "x"))
    assert f"DXB-{code}" in said
    assert words in said


@pytest.mark.parametrize("data", [b"", b"\xff", b"\0", b"\xff\xfes\0", b"summary: \xed\xa0\x80", bytes(range(256))])
def test_bytes_that_are_no_recipe_are_refused(project, dxb, data):
    (project.root / "recipes" / "x.yaml").write_bytes(data)
    assert "DXB-R10" in one_error(dxb("check", "x"))


def test_a_recipe_of_a_gigabyte_is_not_read(project, dxb):
    (project.root / "recipes" / "x.yaml").write_bytes(b"")
    os.truncate(project.root / "recipes" / "x.yaml", 1 << 30)
    assert "larger than 64 MiB" in one_error(dxb("check", "x"))
    (project.root / "recipes" / "x.yaml").unlink()


def chain(project, count: int, text: str) -> None:
    """Files `far/0` ... where each names the next."""
    for number in range(count):
        project.write(f"recipes/far/{number}.yaml", text.replace("NEXT", f"far/{number + 1}"))
    project.write(f"recipes/far/{count}.yaml", nodes(""))


@pytest.mark.medium
@pytest.mark.parametrize(
    "text",
    [
        "extends: NEXT\n",
        nodes("  a: {recipe: NEXT}\n"),
        "inputs: {f: 'NEXT:start'}\n" + nodes("  a: {rule: toy.split, text: $f}\n"),
    ],
    ids=["extends", "recipe", "inputs"],
)
def test_a_chain_of_files_has_an_end(project, dxb, text):
    chain(project, 600, text)
    assert "more than 100 deep" in one_error(dxb("check", "far/0"))
    assert dxb("check", "far/550").code == 0  # fifty are no reason to refuse


def test_a_circle_of_bases_is_refused(project, dxb):
    project.write("recipes/x.yaml", "extends: y\n")
    project.write("recipes/y.yaml", "extends: x\n")
    said = one_error(dxb("check", "x"))
    assert "the recipe extends itself" in said
    assert "extends: x -> y -> x" in said


@pytest.mark.slow
def test_recipes_that_use_one_another_tenfold_are_refused(project, dxb):
    """Twelve files of ten lines each stand for 10^12 nodes."""
    project.write("recipes/many/0.yaml", nodes(""))
    for number in range(1, 12):
        uses = "".join(f"  a{n}: {{recipe: many/{number - 1}}}\n" for n in range(10))
        project.write(f"recipes/many/{number}.yaml", nodes(uses))
    said = one_error(dxb("check", "many/11"))
    assert "DXB-R116" in said


def test_what_links_lead_out_of_the_project_is_no_recipe(project, dxb, tmp_path):
    (tmp_path / "out.yaml").write_text(nodes(""))
    (project.root / "recipes" / "link.yaml").symlink_to(tmp_path / "out.yaml")
    (project.root / "recipes" / "round.yaml").symlink_to("round.yaml")
    (project.root / "recipes" / "device.yaml").symlink_to("/dev/zero")
    os.mkfifo(project.root / "recipes" / "pipe.yaml")
    for name in ("link", "round", "device", "pipe"):
        assert "DXB-U108" in one_error(dxb("check", name))


def test_names_of_files_do_not_reach_the_terminal(project, dxb):
    for name in (b"a\x1b[2J", b"a\nb", b"\xff"):
        with open(os.fsencode(project.root) + b"/recipes/" + name + b".yaml", "w") as file:
            file.write(nodes(""))
    listed = dxb("ls", "--json")
    assert listed.code in (0, 2)
    assert all(c.isprintable() or c in "\n\t" for c in listed.out + listed.err)
