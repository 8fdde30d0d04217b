"""What is taken out with an object: its shadow and what its mask missed, but no other thing."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.view import InstanceMap
from rules.background.holes import hole, remnants, scraps, shaded

SIZE = (240, 320)
WOOD = np.array([168, 140, 110], np.float32)


def table() -> tuple[np.ndarray, np.ndarray]:
    """A photograph (H, W, 3) of wood under uneven light, and its pixels."""
    light = np.linspace(0.9, 1.1, SIZE[1])[None, :, None]
    noise = np.random.default_rng(0).normal(0, 2, (*SIZE, 3))
    return np.clip(WOOD * light + noise, 0, 255).astype(np.uint8), np.ones(SIZE, bool)


def test_a_shadow_is_taken_out_and_a_paper_or_a_dark_magazine_is_not() -> None:
    pixels, level = table()
    taken = np.zeros(SIZE, bool)
    taken[100:140, 140:180] = True
    level &= ~taken
    pixels[100:140, 180:200] = (0.65 * pixels[100:140, 180:200]).astype(np.uint8)
    pixels[60:100, 140:200] = (120, 180, 210)
    pixels[140:190, 140:160] = (25, 25, 30)
    own = shaded(pixels, level, taken)
    assert own[105:135, 183:198].all()
    assert not own[64:96, 144:196].any()
    assert not own[144:186, 143:157].any()
    assert own[10:40].all()


def test_a_pattern_has_no_other_things() -> None:
    pixels, level = table()
    rows, columns = np.indices(SIZE)
    pixels[(rows // 24 + columns // 24) % 2 == 0] = (30, 60, 160)
    pixels[(rows // 24 + columns // 24) % 3 == 0] = (220, 220, 215)
    assert shaded(pixels, level, np.zeros(SIZE, bool)).all()


def test_what_a_mask_missed_goes_and_a_thing_that_reaches_farther_stays() -> None:
    labels = np.zeros(SIZE, np.int32)
    labels[100:140, 140:180] = 1
    wide = hole(InstanceMap(labels=labels, fixed=np.zeros(SIZE, bool)), np.zeros(SIZE, bool), 0.04)
    other, flat = np.zeros(SIZE, bool), np.zeros(SIZE, bool)
    other[110:120, 181:187] = True  # a handle
    other[60:98, 140:180] = True  # a box behind
    other[110:120, 90:138] = flat[110:120, 90:138] = True  # a sheet of paper
    other[130:140, 130:138] = flat[130:140, 130:138] = True  # a highlight on the support
    other[125:130, 181:215] = True  # the shiny end of a tin
    blank = np.zeros(SIZE, bool)
    blank[125:130, 181:215] = True
    found = remnants(other, wide, flat, blank)
    assert found[110:120, 181:187].all()
    assert not found[60:98].any()
    assert found[125:130, 181:215].all()
    assert not remnants(other, wide, flat, np.zeros(SIZE, bool))[125:130, 181:215].any()
    assert not found[110:120, 90:138].any()
    assert not found[130:140, 130:138].any()


def test_a_highlight_next_to_a_mask_goes_and_a_sheet_that_goes_on_stays() -> None:
    labels = np.zeros(SIZE, np.int32)
    labels[100:140, 140:180] = 1
    wide = hole(InstanceMap(labels=labels, fixed=np.zeros(SIZE, bool)), np.zeros(SIZE, bool), 0.04)
    other = np.zeros(SIZE, bool)
    other[110:120, 90:138] = True  # a sheet of paper
    other[130:140, 130:138] = True  # a highlight
    found = scraps(other, wide)
    assert not found[110:120].any()
    assert found[130:140, 130:138].all()
