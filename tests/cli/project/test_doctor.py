"""What `dxb doctor` says of the extras of dxb."""

from __future__ import annotations

import importlib.metadata

import pytest

from dextera_build.cli.project import doctor


def test_every_extra_is_told_and_an_absent_one_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = ["numpy>=2", 'mujoco>=3; extra == "sim"', 'no_such_a>=1; extra == "sim"', 'no-such-b; extra == "far"']
    declared += ['numpy; extra == "here"', 'dextera-build[sim]; extra == "all"']
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: declared)
    rows = {what: (doctor._state(what, fine, found), fine, found) for what, fine, found, _ in doctor._extras()}
    assert list(rows) == ["extra far", "extra here", "extra sim"]
    assert rows["extra far"] == ("absent", True, "absent")
    assert rows["extra here"] == ("ok", True, "installed")
    assert rows["extra sim"][:2] == ("in part", True)
    assert rows["extra sim"][2].startswith("lacks no-such-a: `pip install -e '.[sim]'`")
