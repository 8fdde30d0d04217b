"""Every artifact type that draws itself has an example, whose picture shows something."""

from __future__ import annotations

import inspect
import io

import numpy as np
import pytest

from dextera_build.artifacts.base import Artifact
from tests.artifacts import generated
from tests.artifacts.previews import EXAMPLES, SHEET

DRAWN = {kind.__name__ for kind in generated.kinds() if inspect.isfunction(vars(kind).get("picture"))}


def test_every_type_that_draws_itself_has_an_example() -> None:
    assert set(EXAMPLES) == DRAWN


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
