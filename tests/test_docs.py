"""The pages: their commands exist and run, their links lead somewhere, their references are complete."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from dextera_build.cli import grammar
from dextera_build.cli.documents import DOCUMENTS
from dextera_build.code.loader import Library
from dextera_build.explain import error_codes
from dextera_build.runs.events import Event

REPO = Path(__file__).parent.parent
DOCS = REPO / "dextera_build" / "docs"
EXAMPLES = sorted((REPO / "examples").glob("*/README.md"))
PAGES = [REPO / "README.md", REPO / "cache" / "README.md", *sorted(DOCS.rglob("*.md")), *EXAMPLES]


def name(path: Path) -> str:
    return path.relative_to(REPO).as_posix()


def console(page: Path) -> list[str]:
    """The commands of a page's ```console blocks, prompts and comments taken off."""
    blocks = re.findall(r"^[ ]*```console\n(.*?)^[ ]*```", page.read_text(), re.DOTALL | re.MULTILINE)
    lines = [line.strip() for block in blocks for line in block.split("\n")]
    return [shlex.join(shlex.split(line[2:], comments=True)) for line in lines if line.startswith("$ ")]


COMMANDS = sorted({command for page in PAGES for command in console(page)})


@pytest.fixture(scope="module")
def parser():
    """The parser of all verbs, which takes longer to make than to use."""
    return grammar.parser()


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("dxb ")])
def test_commands_in_pages_are_understood(parser, command):
    parser.parse_args(shlex.split(command)[1:])


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("make ")])
def test_make_targets_in_pages_exist(command):
    assert re.search(rf"^{shlex.split(command)[1]}:", (REPO / "Makefile").read_text(), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text())
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_python_in_pages_is_python(page):
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        ast.parse(block)


@pytest.mark.slow
@pytest.mark.parametrize("page", [*EXAMPLES, DOCS / "ci.md"], ids=name)
def test_an_example_runs_as_its_page_says(page, tmp_path):
    script = "\n".join(["set -eu", *console(page)])
    environment = {name: value for name, value in os.environ.items() if not name.startswith("DXB_")}
    environment |= {
        "DXB_PROFILE": "stub",
        "DXB_DURABLE": "0",
        "DXB_CACHE": str(tmp_path / "store"),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    }
    if page.name == "ci.md":  # it is about two stores, each in its project
        del environment["DXB_CACHE"]
    work = tmp_path / "work"
    shutil.copytree(page.parent, work, ignore=shutil.ignore_patterns("*.md")) if page in EXAMPLES else work.mkdir()
    done = subprocess.run(["bash", "-c", script], cwd=work, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_architecture_lists_every_room():
    layers = re.findall(r"^layers =\n((?: +.*\n)+)", (REPO / ".importlinter").read_text(), re.MULTILINE)[0]
    block = (DOCS / "architecture.md").read_text().partition("## Rooms")[2].split("```")[1]
    listed = [room for line in block.split("\n")[1:] for room in line[:25].split()]
    assert sorted(listed) == sorted(set(re.findall(r"\w+", layers)) - {"__main__"})


def test_there_is_an_example():
    assert EXAMPLES
    assert all(console(page) for page in EXAMPLES)


@pytest.fixture
def reference(monkeypatch):
    """The extension that makes the references."""
    monkeypatch.syspath_prepend(DOCS / "_ext")
    return importlib.import_module("dxb_reference")


def test_the_reference_has_every_verb(reference):
    page = reference.MAKERS["cli"]()
    assert [verb for verb in grammar.VERBS if f"## dxb {verb}\n" not in page] == []


def test_the_reference_has_every_document_and_event(reference):
    page = reference.MAKERS["documents"]()
    assert [name for name, document in DOCUMENTS.items() if f"prints `{document.schema}`" not in page] == []
    events = reference.MAKERS["events"]()
    assert [kind.kind for kind in Event.__subclasses__() if f"| `{kind.kind}` |" not in events] == []


@pytest.mark.medium
def test_every_rule_has_a_page_of_its_own_with_every_option(reference):
    overview, pages = reference.MAKERS["rules"](), reference.rules.pages()
    for found in Library().rules():
        assert f"]({reference.rules.FOLDER}/{found.path}.md)" in overview
        page = pages.pop(found.path)
        assert page.startswith(f"# {found.path}\n")
        assert page.count("\n# ") == 0
        assert [option for option in found.rule.options.model_fields if f"`{option}`" not in page] == []
    assert pages == {}


def test_made_pages_replace_those_of_before_and_leave_equal_ones_alone(reference, tmp_path):
    folder = tmp_path / "rules"
    reference.made.write(folder, {"a": "1", "b": "2"})
    os.utime(folder / "a.md", (1, 1))
    reference.made.write(folder, {"a": "1", "c": "3"})
    assert {file.name: file.read_text() for file in folder.iterdir()} == {"a.md": "1", "c.md": "3"}
    assert (folder / "a.md").stat().st_mtime == 1


def test_every_example_is_on_the_site_and_its_links_lead_somewhere(reference):
    pages = reference.examples.pages()
    assert set(pages) == {page.parent.name for page in EXAMPLES}
    for text in pages.values():
        links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if "://" not in link]
        assert [link for link in links if not (DOCS / "examples" / link).resolve().is_file()] == []
    front = (DOCS / "index.md").read_text()
    assert [name for name in pages if f"\nexamples/{name}\n" not in front] == []
    with pytest.raises(ValueError, match="not on the site"):
        reference.examples.moved("[a](../other/README.md)")


def test_links_to_examples_lead_to_their_pages(reference):
    text = "[a](../../examples/01_first_twin/README.md#the-twin)"
    assert reference.examples.linked(text, "index") == "[a](examples/01_first_twin.md#the-twin)"
    assert reference.examples.linked(f"[a](../{text[4:]}", "benchmarks/twin") == (
        "[a](../examples/01_first_twin.md#the-twin)"
    )


def test_the_gallery_shows_what_commands_build(reference, parser):
    recipes = {file.relative_to(REPO / "recipes").with_suffix("").as_posix() for file in REPO.glob("recipes/**/*.yaml")}
    for shown in reference.gallery.SHOWN:
        assert shown.recipe in recipes
        assert (DOCS / "images" / shown.picture).is_file()
        assert (DOCS / shown.page).is_file()
        assert parser.parse_args(shlex.split(reference.gallery.command(shown))[1:]).targets == [shown.recipe]
    page = reference.MAKERS["gallery"]()
    assert [shown for shown in reference.gallery.SHOWN if f"images/{shown.picture}" not in page] == []


def test_the_front_page_leads_to_every_page():
    """Every page stands in a table of contents, and the front page shows pictures and three ways in."""
    front = (DOCS / "index.md").read_text()
    listed = {line for block in re.findall(r"```{toctree}\n(.*?)```", front, re.DOTALL) for line in block.split("\n")}
    assert {page.stem for page in DOCS.glob("*.md")} - {"index"} - listed == set()
    assert len(re.findall(r"^- \[!\[[^]]+\]\(images/", front, re.MULTILINE)) == 3


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pages_name_no_rows_of_the_plan(page):
    """`B7` and the like number steps of the project's own plan; D65, E76 and F1 are terms."""
    prose = re.sub(r"```.*?```|`[^`]*`|\$[^$]*\$", "", page.read_text(), flags=re.DOTALL)
    assert set(re.findall(r"(?<![\w-])[A-H]\d{1,2}(?![\w-])", prose)) <= {"D65", "E76", "F1"}


@pytest.mark.medium
def test_the_reference_has_every_error(reference):
    sources = [*(REPO / "dextera_build").rglob("*.py"), *(REPO / "rules").rglob("*.py")]
    codes = {code for file in sources for code in re.findall(r'"(DXB-[A-Z]\d{3})"', file.read_text())}
    page = reference.MAKERS["errors"]()
    assert {code for code in codes if f"`{code}`" not in page} == set()


def test_errors_are_found_in_a_checkout_below_a_folder_named_docs(tmp_path, monkeypatch):
    package = tmp_path / "docs" / "dextera_build"
    package.mkdir(parents=True)
    (package / "made.py").write_text('DxbError("it broke", code="DXB-X999")\n')
    monkeypatch.setattr(error_codes, "PACKAGE", package)
    monkeypatch.setattr(error_codes, "bundled", lambda kind: tmp_path / kind)
    assert [error.message for error in error_codes.sites("DXB-X999")] == ["it broke"]


def test_a_marker_that_names_nothing_is_an_error(reference):
    with pytest.raises(KeyError, match="nothing"):
        reference.fill("a\n% generated: nothing\n")


def test_a_table_leaves_out_empty_columns_and_escapes_bars(reference):
    markdown = importlib.import_module("dxb_reference.markdown")
    assert markdown.table(["a", "b"], [["x | y", ""], ["z", ""]]) == "| a |\n| --- |\n| x \\| y |\n| z |\n"
    assert markdown.table(["a"], []) == ""


def test_the_quickstart_names_every_extra():
    extras = tomllib.loads((REPO / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    table = (DOCS / "quickstart.md").read_text().partition("| extra | adds |")[2].partition("\n\n")[0]
    named = re.findall(r"^\| `([a-z]+)` \|", table, re.MULTILINE)
    assert sorted(named) == sorted(extras)


def test_the_readme_states_the_number_of_tests_by_a_bound_that_holds():
    """Tests are added every day, so the page says how many there are at least; a bound of half of them says little."""
    stated = re.search(r"every test, more than ([\d,]+)", (REPO / "README.md").read_text())
    written = sum(
        len(re.findall(r"^ *(?:async )?def test_", file.read_text(), re.MULTILINE))
        for file in (REPO / "tests").rglob("test_*.py")
    )
    assert stated
    assert written / 2 < int(stated[1].replace(",", "")) < written
