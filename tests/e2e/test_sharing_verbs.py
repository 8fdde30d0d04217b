"""`push`, `pull`, `plan` and the settings of remotes, and real servers between two machines."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.e2e.machines import EVERY, given_up, machine, serving, uploads
from tests.e2e.space import Space
from tests.remotes import servers


@pytest.mark.medium
def test_push_and_pull(space: Space, served: str) -> None:
    assert space.build("say/words").code == 0
    pushed = space.dxb("cache", "push", "say/words", "--to", served)
    assert pushed.code == 0, pushed.err
    assert {line.partition("\t")[0] for line in pushed.out.splitlines()} == {f"say/words:{node}" for node in EVERY}
    assert f"{served}: 7 results uploaded" in pushed.err
    assert space.dxb("cache", "push", "say/words", "--to", served).code == 0
    pulled = space.dxb("cache", "pull", "say/words", "--from", served, env={"DXB_CACHE": "two"})
    assert pulled.code == 0, pulled.err
    assert "pulled say/words   7 nodes: 7 fetched" in pulled.err
    assert pulled.out == "all\ttwo/out/say/words/all/all\n"
    assert (space.root / "two/out/say/words/all/all").read_bytes() == b"ONE!!! TWO!!!"
    again = space.dxb("build", "say/words", env={"DXB_CACHE": "two"})
    assert "say/words is up to date   7 nodes" in again.err


@pytest.mark.medium
def test_a_build_says_how_results_from_before_it_reach_a_remote(space: Space) -> None:
    assert space.build("say/words:words").code == 0
    built = space.dxb("build", "say/words", "--console", "plain", "--cache", "local:rw,./share:rw")
    assert built.code == 0, built.err
    (command,) = (line.partition(": ")[2] for line in built.err.splitlines() if "from before this build" in line)
    assert command == "dxb cache push say/words --to ./share"
    assert space.dxb(*command.split()[1:]).code == 0
    fresh = space.dxb(
        "build", "say/words", "--console", "plain", "--cache", "local:rw,./share:r", env={"DXB_CACHE": "two"}
    )
    assert "7 nodes: 7 fetched" in fresh.err


@pytest.mark.medium
def test_a_plan_says_what_a_remote_has(space: Space, served: str) -> None:
    space.build("say/words")
    space.dxb("cache", "push", "say/words", "--to", served)
    rows = space.dxb("plan", "say/words", env={"DXB_CACHE": "two", "DXB_REMOTES": f"{served}:r"}).out
    assert "start\tremote\ttoy.start" in rows
    assert "words\tunknown" in rows
    without = space.dxb("plan", "say/words", env={"DXB_CACHE": "two"}).out
    assert "start\tstale\ttoy.start" in without  # nothing was brought


@pytest.mark.medium
def test_pull_says_what_is_lacking_and_runs_nothing(space: Space, served: str) -> None:
    space.build("say/words:words")
    space.dxb("cache", "push", "say/words:words", "--to", served)
    pulled = space.dxb("cache", "pull", "say/words", "--from", served, env={"DXB_CACHE": "two"})
    assert pulled.code == 1
    assert "error[DXB-S202]: 2 nodes are neither in the store nor in a remote" in pulled.err
    assert "say/words:word[one].loud, say/words:word[two].loud" in pulled.err
    assert "pulled say/words   7 nodes: 2 fetched, 3 wait, 2 lacking" in pulled.err
    assert "`dxb build say/words` builds the missing results" in pulled.err
    more = ("--set", "word[one].loud.times=4")
    pulled = space.dxb("cache", "pull", "say/words", *more, "--from", served, env={"DXB_CACHE": "two"})
    assert "`dxb build say/words --set 'word[one].loud.times=4'` builds the missing results" in pulled.err


@pytest.mark.medium
def test_push_says_what_is_not_built(space: Space, served: str) -> None:
    answer = space.dxb("cache", "push", "say/words", "--to", served)
    assert answer.code == 1
    assert "error[DXB-S201]:" in answer.err
    assert "hint: dxb build say/words" in answer.err


@pytest.mark.slow
def test_push_of_results_without_bytes_is_no_success_unless_they_are_there(space: Space, served: str) -> None:
    space.build("say/words")
    space.dxb("cache", "push", "say/words", "--to", served)
    two = {"DXB_CACHE": "two", "DXB_REMOTES": f"{served}:r"}
    assert space.dxb("build", "say/words", env=two).code == 0
    there = space.dxb("cache", "push", "say/words", "--to", served, env=two)
    assert (there.code, there.out) == (0, f"say/words:all\t{there.out.split()[-1]}\n"), there.err
    elsewhere = space.dxb("cache", "push", "say/words", "--to", "./elsewhere", env=two)
    assert elsewhere.code == 1
    assert "error[DXB-S201]: not uploaded: 6 nodes" in elsewhere.err
    assert "hint: dxb build --whole say/words" in elsewhere.err
    assert space.dxb("build", "--whole", "say/words", env=two).code == 0
    assert space.dxb("cache", "push", "say/words", "--to", "./elsewhere", env=two).code == 0


@pytest.mark.medium
def test_push_to_where_nothing_may_be_written(space: Space) -> None:
    space.build("say/words")
    with serving(space, "served", "--read-only") as url:
        answer = space.dxb("cache", "push", "say/words", "--to", url)
    assert answer.code == 1
    assert answer.out == ""
    assert "7 results were not uploaded" in answer.err
    assert "405: it does not allow that" in answer.err


def test_push_needs_a_remote(space: Space) -> None:
    answer = space.dxb("cache", "push", "say/words")
    assert answer.code == 2
    assert "error[DXB-U136]: no remote may be written" in answer.err
    assert "`--to NAME`" in answer.err
    assert "error[DXB-U133]: no remote is called `lab`" in space.dxb("cache", "pull", "say/words", "--from", "lab").err


def test_the_store_to_read_runs_nothing(space: Space) -> None:
    space.build("say/words:words")
    assert space.dxb("build", "--cache", "local:r", "say/words:words").code == 0
    answer = space.dxb("build", "--cache", "local:r", "say/words")
    assert answer.code == 1
    assert "`word[one].loud` is stale and may not run now" in answer.err


def test_the_configuration_shows_remotes_without_secrets(space: Space) -> None:
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nlab = "https://me:geheim@cache.lab/dxb"\nshare = "../share"\n')
    space.write(
        "dxb.local.toml",
        '[remotes]\nbucket = {address = "s3://twins/dxb", mode = "rw", secret_access_key = "geheim"}\n',
    )
    shown = space.dxb(
        "show", "--config", "--cache", "local:rw,https://you:geheim@host:r", env={"DXB_CACHE": "other"}
    ).out
    assert "geheim" not in shown
    rows = dict(line.split("\t", 1) for line in shown.splitlines())
    assert rows["cache"] == "other\tenvironment"
    assert rows["remotes.lab"] == "https://***@cache.lab/dxb r\tdxb.toml"
    assert rows["remotes.bucket"] == "s3://twins/dxb rw secret_access_key=***\tdxb.local.toml"
    assert rows["use"] == "local:rw,https://***@host:r\tcommand line"


@pytest.mark.medium
def test_a_variable_that_is_not_set(space: Space) -> None:
    space.write("dxb.toml", '[remotes]\nlab = "https://ci:${NOT_SET_HERE}@host/x"\n')
    answer = space.dxb("cache", "pull", "say/words")
    assert answer.code == 2
    assert "error[DXB-U135]: remote `lab` needs the environment variable `NOT_SET_HERE`, which is not set" in answer.err
    built = space.dxb("build", "say/words", "--console", "plain")
    assert built.code == 0
    assert "needs the environment variable `NOT_SET_HERE`" in built.err


def test_serving_where_nothing_can_listen(space: Space, served: str) -> None:
    answer = space.dxb("cache", "serve", "--port", served.rpartition(":")[2])
    assert answer.code == 4
    assert "error[DXB-E331]: cannot listen on 127.0.0.1:" in answer.err
    assert space.dxb("cache", "serve", "--port", "99999").code == 4


@pytest.mark.slow
def test_two_machines_and_nginx(space: Space, tmp_path: Path) -> None:
    (tmp_path / "nginx").mkdir()
    with servers.nginx(tmp_path / "nginx") as url:
        assert uploads(machine(space, "one", "say/words", use=f"{url}:rw")) == [(7, 0)]
        assert machine(space, "two", "say/words", use=f"{url}:r").nodes("fetched") == EVERY
    # Its folder is a store.
    assert machine(space, "three", "say/words", use="./nginx/data:r").nodes("fetched") == EVERY


@pytest.mark.slow
def test_nginx_that_lets_only_some_write(space: Space, tmp_path: Path) -> None:
    (tmp_path / "nginx").mkdir()
    (tmp_path / "nginx/writers").write_text("ci:{PLAIN}geheim\n")
    guard = 'limit_except GET HEAD { auth_basic "dxb"; auth_basic_user_file writers; }'
    with servers.nginx(tmp_path / "nginx", guard) as url:
        refused = machine(space, "one", "say/words", use=f"{url}:rw")
        assert given_up(refused)[0]["reason"] == "PUT was answered 401: it wants a name and a password"
        named = url.replace("http://", "http://ci:geheim@")
        assert space.dxb("cache", "push", "say/words", "--to", named, env={"DXB_CACHE": "one"}).code == 0
        netrc = space.write("netrc", "machine 127.0.0.1 login ci password geheim\n")
        netrc.chmod(0o600)
        by_file = space.dxb("cache", "push", "say/words", "--to", url, env={"DXB_CACHE": "one", "NETRC": str(netrc)})
        assert by_file.code == 0
        assert "geheim" not in by_file.err + by_file.out
        assert machine(space, "two", "say/words", use=f"{url}:r").nodes("fetched") == EVERY


@pytest.mark.slow
def test_two_machines_and_a_bucket(space: Space, tmp_path: Path) -> None:
    (tmp_path / "s3").mkdir()
    with servers.s3(tmp_path / "s3") as endpoint:
        space.write(
            "dxb.toml",
            f'[remotes]\nbucket = {{address = "s3://twins/dxb", endpoint = "{endpoint}", region = "us-east-1"}}\n',
        )
        keys = {"AWS_ACCESS_KEY_ID": "anyone", "AWS_SECRET_ACCESS_KEY": "geheim"}
        first = space.dxb(
            "build", "--console", "jsonl", "say/words", env={**keys, "DXB_CACHE": "one", "DXB_REMOTES": "bucket:rw"}
        )
        assert uploads(first) == [(7, 0)], first.err
        second = space.dxb("build", "--console", "jsonl", "say/words", env={**keys, "DXB_CACHE": "two"})
        assert second.nodes("fetched") == EVERY
        nobody = space.dxb(
            "build", "--console", "plain", "say/words", env={"DXB_CACHE": "three", "AWS_EC2_METADATA_DISABLED": "true"}
        )
        assert nobody.code == 0


@pytest.mark.medium
def test_what_is_checked_pushed_and_pulled_is_told_as_json(space: Space) -> None:
    assert space.dxb("check", "say/words", "--json").rows[0]["target"] == "say/words"
    assert space.build("say/words").code == 0
    sent = space.dxb("cache", "push", "say/words", "--to", "./elsewhere", "--json").rows
    shutil.rmtree(space.root / "cache")
    pulled = space.dxb("cache", "pull", "say/words", "--from", "./elsewhere", "--json").rows
    assert [row["node"] for row in pulled] == ["all"]
    assert len({row["key"] for row in sent}) == len(sent) > 1
    assert (space.root / pulled[0]["file"]).is_file()
