"""Which stores are used: tables, lists, modes, and no secrets in what is shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.errors import UsageError
from dextera_build.project.remotes_table import Choice

TABLE = {
    "lab": "http://cache.lab/dxb",
    "bucket": {
        "address": "s3://twins/dxb",
        "mode": "rw",
        "endpoint": "https://minio:9000",
        "secret_access_key": "geheim",
    },
    "share": "../share",
}


def choice(*layers: dict[str, object]) -> Choice:
    made = Choice(Path("/project/here"))
    for number, layer in enumerate(layers):
        made.take(layer, f"layer {number}")
    return made


def used(made: Choice) -> list[str]:
    return [f"{spec.name}:{spec.mode}" for spec in made.used]


def test_people_read_unless_they_say_otherwise() -> None:
    made = choice({"remotes": TABLE})
    assert used(made) == ["lab:r", "bucket:rw", "share:r"]
    assert made.local == "rw"


def test_a_list_says_all_that_is_used_and_in_which_order() -> None:
    made = choice({"remotes": TABLE}, {"cache": "local:rw, bucket:w ,lab:r"})
    assert used(made) == ["bucket:w", "lab:r"]
    assert used(choice({"remotes": TABLE}, {"cache": "local:rw"})) == []
    assert used(choice({"remotes": TABLE}, {"cache": "lab:off,bucket:r"})) == ["bucket:r"]
    assert used(choice({"remotes": TABLE}, {"remotes": "lab:rw"})) == ["lab:rw"]


def test_remote_stands_for_every_one() -> None:
    assert used(choice({"remotes": TABLE}, {"cache": "local:rw,remote:r"})) == ["lab:r", "bucket:r", "share:r"]
    assert used(choice({"remotes": TABLE}, {"cache": "remote:r,lab:off"})) == ["bucket:r", "share:r"]


def test_addresses_need_no_name() -> None:
    made = choice({"cache": "https://ci:pw@host:8443/dxb:rw,/mnt/share:r,./near:w"})
    assert [(spec.address, spec.mode) for spec in made.used] == [
        ("https://ci:pw@host:8443/dxb", "rw"),
        ("/mnt/share", "r"),
        ("./near", "w"),
    ]
    assert made.used[0].name == "https://***@host:8443/dxb"


def test_a_later_layer_wins_by_name() -> None:
    made = choice({"remotes": TABLE}, {"remotes": {"lab": {"address": "http://other", "mode": "off"}}})
    assert used(made) == ["bucket:rw", "share:r"]


@pytest.mark.parametrize("folder", ["cache", "/mnt/x", "~/.cache/dxb", "./a:r/", "C:x", "a,b", "/tmp/a:b/c"])
def test_a_folder_is_a_folder(folder: str) -> None:
    assert Choice(Path("/project")).take({"cache": folder}, "here") == {"cache": folder}


@pytest.mark.parametrize(
    "text", ["local:rw", "lab:r", "remote:rw", "http://h:1:r", "local:rw,lab", "local:bad", "http://h", "/mnt/a:rw,x"]
)
def test_a_list_is_a_list(text: str) -> None:
    made = choice({"remotes": TABLE})
    assert made.take({"cache": text}, "here") == {}


def test_a_folder_in_the_settings_is_taken_from_the_project() -> None:
    assert choice({"remotes": TABLE}).used[2].address == "/project/share"


def test_nothing_secret_is_shown() -> None:
    made = choice(
        {"remotes": TABLE | {"ci": "https://ci:geheim@host/x", "sas": "https://host/x?sig=geheim"}},
        {"cache": "https://me:geheim@host:r,https://host/y?token=geheim:w"},
    )
    shown = str(made.rows()) + "".join(map(str, made.used))
    assert "geheim" not in shown
    assert made.rows()["remotes.bucket"] == (
        "s3://twins/dxb rw endpoint=https://minio:9000 secret_access_key=***",
        "layer 0",
    )
    assert made.rows()["use"] == ("https://***@host:r,https://host/y?***:w", "layer 1")
    assert choice().rows() == {"remotes": ("none", "default")}


@pytest.mark.parametrize(
    ("layer", "code", "said"),
    [
        ({"remotes": {"Lab": "http://h"}}, "DXB-U130", "`Lab` cannot be the name of a remote"),
        ({"remotes": {"local": "http://h"}}, "DXB-U130", "`local` cannot be the name of a remote"),
        ({"remotes": {"lab": {}}}, "DXB-U131", "remote `lab` has no address"),
        ({"remotes": {"lab": 7}}, "DXB-U131", "remote `lab` has no address"),
        ({"remotes": {"lab": "ftp://h/x"}}, "DXB-U131", "`ftp://h/x` is not the address of a remote"),
        ({"remotes": {"lab": "http://"}}, "DXB-U131", "`http://` is not the address of a remote"),
        ({"remotes": {"lab": {"address": "/x", "mode": "read"}}}, "DXB-U131", "`read` is not a mode of remote `lab`"),
        (
            {"remotes": {"lab": {"address": "/x", "timeout_s": 0}}},
            "DXB-U131",
            "`timeout_s` of remote `lab` is not a time",
        ),
        (
            {"remotes": {"lab": {"address": "http://h", "timout_s": 3}}},
            "DXB-U131",
            "remote `lab` has no setting `timout_s`",
        ),
        ({"cache": "local:rw,lab"}, "DXB-U132", "`lab` does not say how to use a store"),
        ({"cache": "local:what"}, "DXB-U132", "`local:what` does not say how to use a store"),
        ({"cache": "http://u:geheim@h/x"}, "DXB-U132", "`http://***@h/x` does not say how to use a store"),
        ({"cache": "https://u:gehe,geheim@h:r"}, "DXB-U132", "`https://***@h:r` does not say how to use a store"),
        ({"cache": "u:geheim@h:r"}, "DXB-U133", "no remote is called `***@h`"),
        ({"cache": "http://u:geheim@h:r"}, "DXB-U137", "`http://***@h` would send a password or token in the clear"),
        ({"cache": "http://h?t=geheim:r"}, "DXB-U137", "`http://h?***` would send a password or token in the clear"),
        (
            {"remotes": {"lab": {"address": "s3://twins/dxb", "endpoint": "http://minio:9000"}}},
            "DXB-U137",
            "`http://minio:9000` would send a password or token in the clear",
        ),
        ({"cache": "lob:r"}, "DXB-U133", "no remote is called `lob`"),
        ({"cache": "local:off"}, "DXB-U134", "`local:off`: a build needs its store"),
    ],
)
def test_what_is_wrong_is_said(layer: dict[str, object], code: str, said: str) -> None:
    with pytest.raises(UsageError) as caught:
        _ = choice({"remotes": {"lab": "/lab"}} if "cache" in layer else {}, layer).used
    assert (caught.value.code, caught.value.message) == (code, said)
    assert "geheim" not in f"{caught.value.facts} {caught.value.hint}"
