"""Which executor a build uses, and what is said where it cannot."""

from __future__ import annotations

import os

import pytest

from tests.e2e.space import Space

SHARED = {"DXB_REMOTES": "./shared:rw"}


@pytest.mark.parametrize("wrong", ["slurm", "rai", "ray:", "local:here"])
def test_an_executor_that_does_not_exist_is_refused(space: Space, wrong: str) -> None:
    answer = space.dxb("build", "say/words", "--executor", wrong)
    assert answer.code == 2
    assert f"error[DXB-U103]: `executor` cannot be `{wrong}`" in answer.err
    assert "local, ray, ray:HOST:PORT" in answer.err


def test_the_setting_comes_from_file_environment_and_flag(space: Space) -> None:
    space.write("dxb.toml", 'executor = "slurm"\n')
    assert "from      dxb.toml" in space.dxb("build", "say/words").err
    assert "from      environment" in space.dxb("build", "say/words", env={"DXB_EXECUTOR": "pbs"}).err
    assert space.dxb("build", "say/words", "--executor", "local").code == 0


def test_without_the_package_the_error_says_what_to_install(space: Space) -> None:
    space.write("absent/ray.py", "raise ImportError('absent', name='ray')\n")
    path = os.pathsep.join([str(space.root / "absent"), os.environ.get("PYTHONPATH", "")])
    answer = space.dxb("build", "say/words", "--executor", "ray", env={"PYTHONPATH": path, **SHARED})
    assert answer.code == 4
    assert "error[DXB-E350]: `--executor ray` needs the package `ray`, which is not installed" in answer.err
    assert "hint: `pip install -e '.[ray]'`" in answer.err


def test_the_address_of_a_client_server_is_refused(space: Space) -> None:
    answer = space.dxb("build", "say/words", "--executor", "ray:ray://head:10001", env=SHARED)
    assert answer.code == 2
    assert "error[DXB-U178]: `ray://head:10001` is not the address of a Ray cluster" in answer.err


def test_an_address_without_a_port_is_refused(space: Space) -> None:
    answer = space.dxb("build", "say/words", "--executor", "ray:head", env=SHARED)
    assert answer.code == 2
    assert "error[DXB-U178]: `head` is not the address of a Ray cluster" in answer.err
    assert "hint: --executor ray:head:6379" in answer.err


def test_services_are_asked_again_on_one_machine_only(space: Space) -> None:
    answer = space.dxb("build", "say/words", "--executor", "ray", "--calls", "refresh")
    assert answer.code == 2
    assert "error[DXB-U179]: `--calls refresh` asks services again, which a build on a cluster cannot" in answer.err
    assert "hint: `--executor local --calls refresh`" in answer.err
