"""Procedural textures: wood, plaster, concrete, glaze, printed cardboard, a keyboard, a screen.

Each function is pure in its arguments and a seed, and returns (H, W, 3) uint8 sRGB.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Colour = tuple[float, float, float]
"""sRGB 0..1."""


def noise(height: int, width: int, cells: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Smooth noise (H, W) float64, about -1..1: a random (rows, columns) grid with cubic upsampling."""
    from PIL import Image as Pillow

    grid = Pillow.fromarray(rng.uniform(-1, 1, cells).astype(np.float32))
    return np.asarray(grid.resize((width, height), Pillow.Resampling.BICUBIC), np.float64)


def clouds(height: int, width: int, cells: int, octaves: int, rng: np.random.Generator) -> np.ndarray:
    """Fractal noise (H, W): octaves of `noise`, each twice as fine and half as strong."""
    ratio = width / height
    sizes = [cells * 2**octave for octave in range(octaves)]
    layers = [noise(height, width, (n + 2, int(n * ratio) + 2), rng) / 2**i for i, n in enumerate(sizes)]
    return np.asarray(np.sum(layers, axis=0))


def wood(height: int, width: int, colour: Colour, planks: int, seed: int) -> np.ndarray:
    """Planks along the width with growth rings, pores and joints."""
    rng = np.random.default_rng(seed)
    rows = height // planks + 1
    picture = np.zeros((rows * planks, width, 3))
    for plank in range(planks):
        y = np.linspace(-1, 1, rows)[:, None]
        bend = noise(rows, width, (3, 6), rng) * 0.5 + noise(rows, width, (5, 14), rng) * 0.12
        rings = (np.abs(y + rng.uniform(-0.8, 0.8)) + bend) * rng.uniform(5, 8)
        rings = rings + 0.25 * noise(rows, width, (40, 8), rng)
        grain = (1 - np.abs(2 * (rings % 1.0) - 1)) ** 2
        fibres = noise(rows, width, (rows // 2, max(width // 60, 4)), rng)
        pores = np.clip(noise(rows, width, (rows, max(width // 24, 4)), rng) - 0.45, 0, 1)
        shade = 1.0 + rng.uniform(-0.09, 0.09) - 0.17 * grain + 0.06 * fibres - 0.35 * pores
        shade[0] *= 0.55
        shade[1] *= 0.8
        tint = np.array(colour) * (1 + rng.uniform(-0.03, 0.03, 3))
        # Dark grain is redder than light grain.
        picture[plank * rows : (plank + 1) * rows] = tint * shade[..., None] ** np.array([0.85, 1.0, 1.15])
    return _bytes(picture[:height])


def plain(height: int, width: int, colour: Colour, grain: float, cells: int, seed: int) -> np.ndarray:
    """One colour with fractal blotches of relative strength `grain`: plaster, concrete, carpet, glaze."""
    rng = np.random.default_rng(seed)
    shade = 1.0 + grain * clouds(height, width, cells, 4, rng) + 0.3 * grain * rng.standard_normal((height, width))
    return _bytes(np.array(colour) * shade[..., None])


def speckled(height: int, width: int, colour: Colour, speck: Colour, density: float, seed: int) -> np.ndarray:
    """Stoneware: a colour with soft specks of another."""
    rng = np.random.default_rng(seed)
    base = plain(height, width, colour, 0.03, 6, seed) / 255.0
    spots = np.clip((noise(height, width, (height // 3, width // 3), rng) - (0.95 - density)) * 6, 0, 1)
    return _bytes(base * (1 - spots[..., None]) + np.array(speck) * spots[..., None])


def banded(picture: np.ndarray, bands: tuple[tuple[float, float, Colour], ...]) -> np.ndarray:
    """`picture` with horizontal bands: lower and upper end as fractions of the height from below, and a colour."""
    out = picture.copy()
    for low, high, colour in bands:
        rows = slice(round((1 - high) * len(out)), round((1 - low) * len(out)))
        out[rows] = _bytes(np.array(colour) * (0.9 + 0.1 * picture[rows].mean(axis=-1, keepdims=True) / 128))
    return out


def carton(brand: str, line: str, colour: Colour, accent: Colour, seed: int) -> np.ndarray:
    """Atlas of a printed cardboard box: six cells, three columns and two rows (see `solids.CELLS`)."""
    front = _panel(colour, accent, seed, brand, line, sun=True)
    side = _panel(accent, colour, seed + 1, brand, "NET WT 340 g", sun=False)
    back = _panel(colour, accent, seed + 2, brand, "BEST BEFORE 08/27", sun=False, lines=14)
    left = _panel(accent, colour, seed + 3, brand, "KEEP DRY", sun=False, lines=9)
    top = _panel(colour, accent, seed + 4, "", "OPEN HERE", sun=False)
    bottom = plain(768, 512, (0.62, 0.48, 0.33), 0.05, 8, seed + 5)
    return np.concatenate([np.concatenate(row, axis=1) for row in ((front, side, back), (left, top, bottom))])


def keyboard(seed: int) -> np.ndarray:
    """Upper half: palm rest, keys and touch pad of a laptop from above; lower half: its bottom."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    body = plain(704, 1024, (0.66, 0.67, 0.69), 0.012, 40, seed)
    picture = Pillow.fromarray(body)
    draw = ImageDraw.Draw(picture)
    draw.rounded_rectangle((66, 70, 958, 388), 14, fill=(38, 39, 42))
    letters = ("`1234567890-=", " QWERTYUIOP[]", " ASDFGHJKL;' ", " ZXCVBNM,./  ")
    for row in range(5):
        _key_row(draw, row, letters[row] if row < 4 else "")
    draw.rounded_rectangle((352, 436, 672, 668), 12, fill=(158, 160, 165), outline=(120, 122, 126), width=3)
    for x in (16, 980):
        for y in range(110, 360, 9):
            for dot in range(3):
                draw.ellipse((x + dot * 9, y, x + dot * 9 + 4, y + 4), fill=(70, 71, 74))
    return np.concatenate([np.asarray(picture), plain(704, 1024, (0.60, 0.61, 0.63), 0.012, 40, seed + 1)])


def screen(seed: int) -> np.ndarray:
    """Upper half: the back of a laptop's lid; lower half: its display with a bezel, upright for the user."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    width, height = 1024, 704
    y, x = np.mgrid[0:height, 0:width] / [[[height]], [[width]]]
    rng = np.random.default_rng(seed)
    glow = 0.5 + 0.5 * np.sin(3 * x + 2 * clouds(height, width, 2, 3, rng))
    desk = np.stack([0.10 + 0.16 * glow, 0.25 + 0.25 * y, 0.48 + 0.25 * (1 - y)], axis=-1)
    picture = Pillow.fromarray(_bytes(desk))
    draw = ImageDraw.Draw(picture)
    _window(draw, (110, 96, 600, 560), seed)
    draw.rounded_rectangle((640, 150, 930, 420), 10, fill=(245, 245, 242))
    for bar, size in enumerate(rng.uniform(0.25, 0.95, 7)):
        left = 668 + bar * 35
        draw.rectangle((left, 396 - 190 * size, left + 22, 396), fill=(230, 126, 34) if bar % 2 else (41, 128, 185))
    draw.rectangle((0, 640, width, height), fill=(24, 26, 33))
    for icon in range(6):
        left = 380 + icon * 46
        draw.rounded_rectangle((left, 650, left + 30, 680), 7, fill=tuple(rng.integers(90, 240, 3).tolist()))
    edge = (18, 18, 20)
    draw.rectangle((0, 0, width, 26), fill=edge)
    draw.rectangle((0, height - 22, width, height), fill=edge)
    draw.rectangle((0, 0, 22, height), fill=edge)
    draw.rectangle((width - 22, 0, width, height), fill=edge)
    lid = plain(height, width, (0.64, 0.65, 0.67), 0.012, 40, seed + 1)
    return np.concatenate([lid, np.asarray(picture)])


def _key_row(draw: Any, row: int, letters: str) -> None:
    top = 82 + row * 61
    widths = [1.0] * 13 + [1.6] if row < 4 else [1.2, 1.2, 1.2, 6.0, 1.2, 1.2, 1.2, 1.4]
    unit = 872 / sum(widths)
    left = 76.0
    for key, size in enumerate(widths):
        right = left + size * unit
        draw.rounded_rectangle((left + 3, top + 3, right - 3, top + 54), 6, fill=(24, 24, 26))
        if key < len(letters):
            draw.text((left + 18, top + 12), letters[key], font=_font(24), fill=(225, 226, 230))
        left = right


def _window(draw: Any, frame: tuple[int, int, int, int], seed: int) -> None:
    rng = np.random.default_rng(seed + 9)
    left, top, right, bottom = frame
    draw.rounded_rectangle(frame, 10, fill=(30, 33, 42))
    draw.rounded_rectangle((left, top, right, top + 30), 10, fill=(52, 56, 68))
    for dot, colour in enumerate(((236, 95, 86), (245, 190, 79), (97, 197, 84))):
        draw.ellipse((left + 14 + dot * 24, top + 9, left + 27 + dot * 24, top + 22), fill=colour)
    inks = ((130, 170, 255), (195, 232, 141), (247, 140, 108), (200, 204, 215), (137, 221, 255))
    for y in range(top + 46, bottom - 16, 19):
        x = left + 20 + 26 * int(rng.integers(0, 4))
        while x < right - 90 and rng.uniform() > 0.2:
            size = int(rng.integers(18, 90))
            draw.rectangle((x, y, x + size, y + 8), fill=inks[int(rng.integers(0, 5))])
            x += size + 10


def _panel(
    colour: Colour, accent: Colour, seed: int, brand: str, line: str, *, sun: bool, lines: int = 0
) -> np.ndarray:
    from PIL import Image as Pillow
    from PIL import ImageDraw

    picture = Pillow.fromarray(plain(768, 512, colour, 0.02, 12, seed))
    draw = ImageDraw.Draw(picture)
    ink = tuple(int(255 * c) for c in accent)
    dark = tuple(int(90 * c) for c in accent)
    if sun:
        for ray in range(18):
            draw.pieslice((36, 250, 476, 690), ray * 20, ray * 20 + 10, fill=ink)
        draw.ellipse((126, 340, 386, 600), fill=(252, 246, 230))
        for petal in range(9):
            angle = 2 * np.pi * petal / 9
            x, y = 256 + 74 * np.cos(angle), 470 + 74 * np.sin(angle)
            draw.ellipse((x - 40, y - 40, x + 40, y + 40), fill=(196, 120, 52), outline=(150, 84, 30), width=4)
        draw.ellipse((206, 420, 306, 520), fill=(224, 160, 88))
    if brand:
        draw.rounded_rectangle((24, 60, 488, 200), 26, fill=dark)
        draw.text((256, 130), brand, font=_font(104), fill=(255, 250, 240), anchor="mm")
    draw.text((256, 226 if brand else 384), line, font=_font(40), fill=dark, anchor="mt")
    rng = np.random.default_rng(seed)
    for row in range(lines):
        draw.rectangle((56, 300 + row * 28, 56 + int(rng.integers(200, 400)), 308 + row * 28), fill=dark)
    if not sun and brand:
        _bar_code(draw, rng)
    return np.asarray(picture)


def _bar_code(draw: Any, rng: np.random.Generator) -> None:
    draw.rectangle((300, 640, 470, 740), fill=(250, 250, 250))
    x = 312
    while x < 456:
        size = int(rng.integers(2, 7))
        draw.rectangle((x, 650, x + size, 728), fill=(15, 15, 15))
        x += size + int(rng.integers(3, 7))


def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.asarray(np.round(np.clip(colours, 0, 1) * 255), np.uint8)
