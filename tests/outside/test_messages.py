"""The messages, their published schemas, and the helper for programs say the same."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.errors import RuleError
from dextera_build.outside import messages
from dextera_build.outside.program_side import dxb_backend

OK: dict[str, Any] = {"protocol": 1, "status": "ok", "output": 1}
REFUSED: dict[str, Any] = {"protocol": 1, "status": "refused", "message": "no"}


def response(folder: Path, message: Any) -> Path:
    (folder / "response.json").write_text(message if isinstance(message, str) else json.dumps(message))
    return folder


@pytest.mark.parametrize("kind", [messages.Request, messages.Response])
def test_the_published_schemas_are_those_of_the_messages(kind):
    """`messages.schema` makes them."""
    text = (messages.SCHEMAS / f"{kind.__name__.lower()}.schema.json").read_text()
    assert json.loads(text) == messages.schema(kind)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.text(max_size=3) | st.floats(-2, 2),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=2), inner, max_size=2),
    max_leaves=4,
)


@pytest.mark.medium
@given(
    base=st.sampled_from([OK, REFUSED]),
    name=st.sampled_from(["protocol", "status", "output", "line", "metrics", "message", "hint", "other"]),
    value=JSON | st.sampled_from([1, "ok", "refused", {"a": [1.5, "m"]}]),
)
def test_dxb_takes_what_the_schema_takes(base, name, value, tmp_path_factory):
    message = {**base, name: value}
    folder = response(tmp_path_factory.mktemp("answer"), message)
    published = json.loads((messages.SCHEMAS / "response.schema.json").read_text())
    try:
        jsonschema.validate(message, published)
    except jsonschema.ValidationError:
        with pytest.raises(RuleError):
            messages.read(folder)
    else:
        if not isinstance(message["protocol"], float):
            assert messages.read(folder).status == message["status"]


@pytest.mark.parametrize(
    ("message", "why"),
    [
        ("garbage", "it is not JSON"),
        ("[" * 100_000, "it is not JSON"),
        ('{"protocol": 1, "status": "ok", "output": NaN}', "NaN is no JSON number"),
        ([], "status"),
        ({**OK, "protocol": 2}, "it speaks protocol 2, dxb speaks 1"),
        ({**OK, "protocol": True}, "it speaks protocol True, dxb speaks 1"),
        ({**OK, "status": "fine"}, "status"),
        ({**OK, "lines": "a"}, "`lines`: Extra inputs"),
        ({"protocol": 1, "status": "refused"}, "`message`: Field required"),
        ({**OK, "metrics": {"a": 1}}, "`metrics.a`"),
    ],
)
def test_what_is_no_response_is_told(tmp_path, message, why):
    with pytest.raises(RuleError) as caught:
        messages.read(response(tmp_path, message))
    assert caught.value.code == "DXB-B375"
    assert why in caught.value.facts["why"]
    assert caught.value.hint


def test_a_response_that_is_too_large_is_not_read(tmp_path):
    with (tmp_path / "response.json").open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(RuleError) as caught:
        messages.read(tmp_path)
    assert "large values belong in files" in caught.value.facts["why"]


def test_a_link_is_no_response(tmp_path):
    (tmp_path / "other.json").write_text(json.dumps(OK))
    (tmp_path / "response.json").symlink_to(tmp_path / "other.json")
    with pytest.raises(RuleError, match="ended without an answer"):
        messages.read(tmp_path)


def test_the_helper_needs_python_3_8_and_nothing_else():
    text = Path(dxb_backend.__file__).read_text()
    module = ast.parse(text, feature_version=(3, 8))
    imported = {node.module for node in ast.walk(module) if isinstance(node, ast.ImportFrom)}
    imported |= {name.name for node in ast.walk(module) if isinstance(node, ast.Import) for name in node.names}
    assert imported == {"__future__", "collections.abc", "json", "os", "shutil", "sys", "pathlib", "typing"}
    assert dxb_backend.PROTOCOL == messages.PROTOCOL
