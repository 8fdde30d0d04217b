"""Every artifact type that draws itself has an example, whose picture shows something."""

from __future__ import annotations

import io
from importlib import import_module

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact
from dextera_build.previews import registry
from tests.previews.examples import EXAMPLES, SHEET

TABLES = {name: import_module(f"dextera_build.previews.{name}") for name in registry.MODULES}


def test_every_type_with_a_picture_has_an_example() -> None:
    assert set(EXAMPLES) == {kind.__name__ for table in TABLES.values() for kind in table.PICTURES}


def test_the_registry_names_the_types_of_each_module() -> None:
    for name, table in TABLES.items():
        assert tuple(sorted({kind.__name__ for kind in (*table.FACTS, *table.PICTURES)})) == registry.MODULES[name]


@pytest.mark.medium
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_picture_of_an_example_shows_something(name: str) -> None:
    from PIL import Image

    value = EXAMPLES[name]()
    assert (type(value).__name__, isinstance(value, Artifact)) == (name, True)
    picture = Image.open(io.BytesIO(value.picture() or b""))
    assert picture.format == "PNG"
    assert min(picture.size) >= 64
    pixels = np.asarray(picture.convert("RGB"))
    background = (pixels == pixels[0, 0]).all(axis=-1)
    assert (~background).mean() > 0.005
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 3


def test_the_sheet_of_the_docs_is_small() -> None:
    assert 50_000 < SHEET.stat().st_size < 400_000
