"""Nothing of the user's leaves the machine without consent for this service and this kind of data."""

from __future__ import annotations

import pytest

from dextera_build.calls.consent import Consents, refuse
from dextera_build.calls.question import question
from dextera_build.calls.recorder import Recorder
from dextera_build.calls.terms import Terms, written
from dextera_build.errors import MachineError, UsageError
from dextera_build.store.store import Store

PNG = b"\x89PNG\r\n\x1a\n" + b"0" * 100
JPEG = b"\xff\xd8\xff\xe0" + b"0" * 100
WEBP = b"RIFF\x00\x00\x00\x00WEBP"


@pytest.fixture(autouse=True)
def no_variable(monkeypatch):
    monkeypatch.delenv("DXB_CONSENT", raising=False)


@pytest.fixture
def consents(tmp_path):
    return Consents(tmp_path / "config" / "consents.json", "/home/me/project")


@pytest.mark.parametrize(
    ("request_", "data", "kinds"),
    [
        ({"q": "what?"}, (), ()),
        ({"picture": PNG}, (), ("photograph",)),
        ({"pictures": [b"text", {"inner": JPEG}]}, (), ("photograph",)),
        ({"url": "data:image/jpeg;base64,AAAA"}, (), ("photograph",)),
        ({"picture": WEBP}, ("photograph",), ("photograph",)),
        ({"mesh": b"solid"}, ("mesh",), ("mesh",)),
        ({"mesh": b"solid", "picture": PNG}, ("mesh",), ("mesh", "photograph")),
    ],
)
def test_pictures_count_named_or_not(request_, data, kinds):
    asked = question("forge", request_, (), data)
    assert asked.data == kinds
    assert asked.key == question("forge", request_).key  # the kind is no part of the request


def test_without_consent_nothing_is_sent(tmp_path):
    store = Store(tmp_path / "store")
    terms = Terms.read(written({}, None, "", [("other", "photograph"), ("forge", "mesh")]))
    with pytest.raises(MachineError, match="`forge` would receive a photograph, without your consent") as caught:
        Recorder(store, "record", terms=terms)("forge", {"p": PNG}, lambda seconds: pytest.fail("it was sent"))
    error = caught.value
    assert error.code == "DXB-E365"
    assert (error.facts["service"], error.facts["data"]) == ("forge", "photograph")
    assert error.hint == "`dxb consent give forge photograph`; in CI DXB_CONSENT=forge:photograph"
    # An answer that is known needs no consent, and a build without terms sends nothing.
    allowed = Terms.read(written({}, None, "", [("forge", "photograph")]))
    assert Recorder(store, "record", terms=allowed)("forge", {"p": PNG}, lambda seconds: b"yes") == b"yes"
    assert Recorder(store, "record", terms=terms)("forge", {"p": PNG}, lambda seconds: b"no") == b"yes"
    with pytest.raises(MachineError):
        Recorder(store, "refresh", terms=Terms.read(""))("forge", {"p": PNG}, lambda seconds: b"no")


def test_consent_is_given_shown_and_withdrawn(consents, tmp_path):
    assert consents.all() == []
    consents.give("forge", ["photograph", "mesh"])
    consents.give("chat", ["photograph"], everywhere=True)
    consents.give("chat", ["photograph"], everywhere=True)  # once
    assert [one.what for one in consents.all()] == [
        ("chat", "photograph", "*"),
        ("forge", "mesh", "/home/me/project"),
        ("forge", "photograph", "/home/me/project"),
    ]
    assert all(len(one.given) == 10 for one in consents.all())
    other = Consents(tmp_path / "config" / "consents.json", "/home/me/other")
    assert other.here() == [("chat", "photograph")]
    assert other.withdraw("forge", []) == 0
    assert consents.withdraw("forge", ["mesh"]) == 1
    assert consents.here() == [("chat", "photograph"), ("forge", "photograph")]
    assert consents.withdraw("chat", []) == 1
    assert other.here() == []


@pytest.mark.parametrize("text", ["", "[]", "{", '{"consents": [{"service": 1}]}', '{"consents": 3}'])
def test_a_damaged_file_is_no_consent(consents, text):
    consents._path.parent.mkdir()
    consents._path.write_text(text)
    assert consents.all() == []
    consents.give("forge", ["mesh"])
    assert len(consents.all()) == 1


@pytest.mark.parametrize(
    ("variable", "passes"),
    [
        ("forge:photograph", True),
        ("chat:mesh, forge:photograph", True),
        ("forge:*", True),
        ("all", True),
        ("forge:mesh", False),
        ("forges:photograph", False),
    ],
)
def test_the_variable_of_ci(consents, monkeypatch, variable, passes):
    monkeypatch.setenv("DXB_CONSENT", variable)
    asked = question("forge", {"p": PNG})
    if passes:
        refuse(asked, consents.here())
    else:
        with pytest.raises(MachineError):
            refuse(asked, consents.here())


def test_a_variable_of_another_form_is_refused(consents, monkeypatch):
    monkeypatch.setenv("DXB_CONSENT", "forge")
    with pytest.raises(UsageError, match="`forge` in `DXB_CONSENT` is not a service with a kind of data") as caught:
        consents.here()
    assert caught.value.code == "DXB-U181"
    assert caught.value.hint == "DXB_CONSENT=forge:*, or DXB_CONSENT=all"
