"""The table of schemes: one module and one line add a remote, and what reads settings reads the table."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from dextera_build.errors import UsageError
from dextera_build.remotes import schemes
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.spec import Spec, from_table, open_remote


def test_one_module_and_one_line_add_a_remote(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    module = ModuleType("dextera_build.remotes.shelf")
    asked = []
    module.opened = lambda *asks: asked.append(asks) or Directory(tmp_path)  # type: ignore[attr-defined, func-returns-value]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(schemes.SCHEMES, "shelf", schemes.Scheme("shelf", tuned=True))
    (spec,) = from_table({"lab": {"address": "shelf://a/b", "timeout_s": 2.0, "level": 3}}, "dxb.toml").values()
    assert isinstance(open_remote(spec), Directory)
    assert asked == [("shelf://a/b", {"level": "3"}, 2.0)]
    with pytest.raises(UsageError) as caught:
        from_table({"lab": "shlf://a/b"}, "dxb.toml")
    assert "shelf" in str(caught.value.facts["schemes"])
    assert caught.value.hint == "did you mean `shelf://`?"
    with pytest.raises(UsageError) as caught:
        from_table({"lab": {"address": "https://h/x", "level": 3}}, "dxb.toml")
    assert "shelf" in str(caught.value.facts["more"])


@pytest.mark.parametrize("scheme", schemes.SCHEMES)
def test_every_scheme_opens_what_implements_a_remote(scheme: str, tmp_path: Path) -> None:
    address = f"{scheme}://{tmp_path if scheme == schemes.FOLDER else 'twins/prefix'}"
    options = {"account_name": "a"} if scheme == "az" else {}
    opened = open_remote(Spec("lab", address, options=options))
    assert type(opened).__module__ == f"dextera_build.remotes.{schemes.SCHEMES[scheme].module}"
    opened.close()


def test_settings_are_read_without_the_libraries_of_remotes() -> None:
    code = (
        "import sys; from dextera_build.remotes import spec;"
        "spec.from_table({'a': 's3://b/c', 'd': 'https://e/f'}, '');"
        "print(*{'httpx', 'obstore'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
