"""Procedural surface textures of streets, houses and furniture, from asphalt to wicker, and lettering."""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, UInt8Array

_SIZE = 512


def fractal_noise(
    rng: np.random.Generator, size_px: int, coarse: int = 4, octaves: int = 6, gain: float = 0.55
) -> Float32Array:
    """Tiling fractal noise, shape (size, size), zero mean and unit standard deviation.

    Args:
        rng: Source of the noise.
        size_px: Side of the square.
        coarse: Cells along a side of the first octave.
        octaves: How many times the cells are halved.
        gain: Height of an octave relative to the one before.
    """
    total = np.zeros((size_px, size_px), np.float32)
    for k in range(octaves):
        cells = min(coarse * 2**k, size_px)
        grid = rng.normal(size=(cells, cells)).astype(np.float32)
        # wrap a border so that the enlarged grid tiles
        padded = np.pad(grid, 2, mode="wrap")
        scale = size_px / cells
        big = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        start = round(2 * scale)
        total += gain**k * big[start : start + size_px, start : start + size_px]
    total -= total.mean()
    return total / max(float(total.std()), 1e-6)


def _blur(picture: Float32Array, sigma_x_px: float, sigma_y_px: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_x_px, sigmaY=sigma_y_px), np.float32)


def _paint(
    base: tuple[float, float, float], light: Float32Array, tint: Float32Array | None = None
) -> UInt8Array:
    """sRGB picture of a base colour (0..255) times light, with an optional warm-cold tint."""
    rgb = np.asarray(base, np.float32) * light[..., None]
    if tint is not None:
        rgb = rgb + tint[..., None] * np.array([6.0, 1.0, -6.0], np.float32)
    return _bytes(rgb)


def _bytes(rgb: NDArray[np.floating]) -> UInt8Array:
    return np.asarray(np.clip(rgb, 0, 255), np.uint8)


def _wander(rng: np.random.Generator, size: int, steps: int, step_px: float) -> NDArray[np.int32]:
    heading = rng.uniform(0, 6.28) + np.cumsum(rng.normal(0, 0.35, steps))
    path = rng.uniform(0, size, 2) + np.cumsum(
        np.stack([np.cos(heading), np.sin(heading)], 1) * step_px, axis=0
    )
    return path.astype(np.int32)


def _asphalt(rng: np.random.Generator) -> UInt8Array:
    size = 1024
    grain = rng.normal(size=(size, size)).astype(np.float32)
    light = 1 + 0.13 * grain + 0.07 * fractal_noise(rng, size, 3) + 0.05 * fractal_noise(rng, size, 48, 3)
    for _ in range(rng.integers(1, 4)):  # mended patches
        x, y = rng.integers(60, size - 360, 2)
        w, h = rng.integers(80, 300, 2)
        light[y : y + h, x : x + w] *= rng.uniform(0.72, 1.15)
        cv2.rectangle(light, (int(x), int(y)), (int(x + w), int(y + h)), float(rng.uniform(0.5, 0.7)), 3)
    for _ in range(rng.integers(2, 7)):  # cracks, some sealed with tar
        cv2.polylines(
            light, [_wander(rng, size, 60, 9)], False, float(rng.uniform(0.35, 0.6)), int(rng.integers(1, 4))
        )
    for _ in range(rng.integers(3, 12)):  # oil and wear
        spot = np.zeros((size, size), np.float32)
        centre = (int(rng.integers(size)), int(rng.integers(size)))
        cv2.ellipse(
            spot,
            centre,
            (int(rng.integers(8, 50)), int(rng.integers(6, 30))),
            float(rng.uniform(0, 180)),
            0,
            360,
            1,
            -1,
        )
        light *= 1 - rng.uniform(0.05, 0.3) * _blur(spot, 6, 6)
    return _paint((108, 107, 106), light, fractal_noise(rng, size, 4, 3) * 0.15)


def _slabs(rng: np.random.Generator, across: int = 4, down: int = 6, joint: int = 4) -> UInt8Array:
    tone = np.kron(rng.normal(1, 0.07, (down, across)), np.ones((-(-_SIZE // down), -(-_SIZE // across))))
    light = tone[:_SIZE, :_SIZE].astype(np.float32)
    light = (
        light + 0.07 * fractal_noise(rng, _SIZE, 8) + 0.05 * rng.normal(size=light.shape).astype(np.float32)
    )
    for k in range(across):
        light[:, k * _SIZE // across : k * _SIZE // across + joint] *= 0.6
    for k in range(down):
        light[k * _SIZE // down : k * _SIZE // down + joint] *= 0.6
    for _ in range(30):  # chewing gum and stains
        cv2.circle(
            light,
            tuple(int(v) for v in rng.integers(0, _SIZE, 2)),
            int(rng.integers(2, 7)),
            float(rng.uniform(0.5, 0.8)),
            -1,
        )
    return _paint((152, 147, 140), light)


def _cobbles(rng: np.random.Generator) -> UInt8Array:
    return _bond(rng, rows=24, columns=20, base=(118, 112, 106), joint=(70, 66, 60), spread=0.14)


def _bricks(rng: np.random.Generator) -> UInt8Array:
    base = [(150, 82, 62), (164, 104, 78), (128, 72, 58), (176, 150, 118), (120, 100, 92)][rng.integers(5)]
    return _bond(rng, rows=26, columns=9, base=base, joint=(168, 160, 150), spread=0.13)


def _bond(
    rng: np.random.Generator,
    *,
    rows: int,
    columns: int,
    base: tuple[float, float, float],
    joint: tuple[float, float, float],
    spread: float,
) -> UInt8Array:
    """Courses of stones, every second one shifted by half a stone."""
    y, x = np.mgrid[0:_SIZE, 0:_SIZE].astype(np.float32) / _SIZE
    row = np.floor(y * rows).astype(int)
    shifted = x * columns + 0.5 * (row % 2)
    column = np.floor(shifted).astype(int) % columns
    tone = rng.normal(1, spread, (rows, columns))[row, column].astype(np.float32)
    height_px, width_px = _SIZE / rows, _SIZE / columns
    edge = np.minimum(
        np.minimum((y * rows) % 1, 1 - (y * rows) % 1) * height_px,
        np.minimum(shifted % 1, 1 - shifted % 1) * width_px,
    )
    stone = np.clip(edge / 1.6, 0, 1)[..., None]
    light = tone + 0.06 * fractal_noise(rng, _SIZE, 8) + 0.05 * rng.normal(size=tone.shape).astype(np.float32)
    mortar = _paint(joint, 1 + 0.1 * fractal_noise(rng, _SIZE, 16))
    return _bytes(stone * _paint(base, light) + (1 - stone) * mortar)


def _plaster(rng: np.random.Generator) -> UInt8Array:
    light = 1 + 0.035 * fractal_noise(rng, _SIZE, 3) + 0.03 * fractal_noise(rng, _SIZE, 64, 3)
    streak = _blur(rng.normal(size=(_SIZE, _SIZE)).astype(np.float32), 4, 60)
    light = light - 0.04 * np.abs(streak / streak.std())
    return _paint((225, 222, 216), light)


def _concrete(rng: np.random.Generator) -> UInt8Array:
    light = (
        1 + 0.07 * fractal_noise(rng, _SIZE, 3) + 0.05 * rng.normal(size=(_SIZE, _SIZE)).astype(np.float32)
    )
    for k in (0, _SIZE // 2):
        light[k : k + 4] *= 0.75
        light[:, k : k + 3] *= 0.8
    return _paint((160, 158, 152), light)


def _grass(rng: np.random.Generator) -> UInt8Array:
    fine = fractal_noise(rng, _SIZE, 64, 4, 0.8)
    light = 1 + 0.22 * fine + 0.14 * fractal_noise(rng, _SIZE, 4)
    return _paint((88, 98, 62), light, fractal_noise(rng, _SIZE, 8))


def _leaves(rng: np.random.Generator) -> UInt8Array:
    picture = np.zeros((_SIZE, _SIZE, 3), np.uint8) + np.array([16, 24, 10], np.uint8)
    n = 2600
    centres = rng.integers(0, _SIZE, (n, 2))
    for i in range(n):  # later leaves lie in front and catch more light
        shade = (0.35 + 0.75 * i / n) * rng.uniform(0.7, 1.25)
        colour = [float(min(255.0, c * shade)) for c in (88 + 30 * rng.random(), 122, 48)]
        axes = (int(rng.integers(4, 10)), int(rng.integers(2, 5)))
        for shift in ((0, 0), (_SIZE, 0), (0, _SIZE)):
            cv2.ellipse(
                picture,
                (int(centres[i, 0] - shift[0]), int(centres[i, 1] - shift[1])),
                axes,
                float(rng.uniform(0, 180)),
                0,
                360,
                colour,
                -1,
            )
    return picture


def _bark(rng: np.random.Generator) -> UInt8Array:
    ridges = _blur(rng.normal(size=(_SIZE, _SIZE)).astype(np.float32), 2, 18)
    return _paint((104, 88, 70), 1 + 0.25 * ridges / ridges.std() + 0.1 * fractal_noise(rng, _SIZE, 6))


def _planks(rng: np.random.Generator) -> UInt8Array:
    boards = 12
    grain = _blur(rng.normal(size=(_SIZE, _SIZE)).astype(np.float32), 1.2, 40)
    tone = np.repeat(rng.normal(1, 0.12, boards), -(-_SIZE // boards))[:_SIZE].astype(np.float32)
    light = tone[None] + 0.12 * grain / grain.std()
    for k in range(boards):
        light[:, k * _SIZE // boards : k * _SIZE // boards + 4] *= 0.35
    return _paint((150, 118, 82), light)


def _corrugated(rng: np.random.Generator) -> UInt8Array:
    x = np.arange(_SIZE) / _SIZE
    light = np.tile((1 + 0.22 * np.sin(2 * np.pi * 16 * x)).astype(np.float32), (_SIZE, 1))
    return _paint((190, 192, 194), light + 0.05 * fractal_noise(rng, _SIZE, 4))


def _shutter(rng: np.random.Generator) -> UInt8Array:
    return np.ascontiguousarray(_corrugated(rng).transpose(1, 0, 2))


def _rust(rng: np.random.Generator) -> UInt8Array:
    noise = fractal_noise(rng, _SIZE, 4)
    paint = _paint((200, 196, 190), 1 + 0.05 * fractal_noise(rng, _SIZE, 32, 3)).astype(np.float32)
    rust = _paint((120, 70, 42), 1 + 0.2 * fractal_noise(rng, _SIZE, 16)).astype(np.float32)
    share = np.clip((noise - 1.1) * 2, 0, 1)[..., None]
    return _bytes(paint * (1 - share) + rust * share)


def _roof(rng: np.random.Generator) -> UInt8Array:
    return _bond(rng, rows=14, columns=12, base=(126, 74, 58), joint=(56, 36, 30), spread=0.1)


def _curtain(rng: np.random.Generator) -> UInt8Array:
    """What is seen in a window: a dark room, often a curtain, a blind or a lamp."""
    light = np.full((_SIZE, _SIZE), rng.uniform(0.25, 0.6), np.float32)
    light += 0.06 * fractal_noise(rng, _SIZE, 3)
    style = rng.integers(4)
    x = np.arange(_SIZE, dtype=np.float32)
    if style == 0:
        drawn = (x < _SIZE * rng.uniform(0.15, 0.4)) | (x > _SIZE * rng.uniform(0.65, 0.85))
        light += drawn * (1.25 + 0.25 * np.sin(x / 9))
    elif style == 1:
        lowered = x < _SIZE * rng.uniform(0.2, 0.8)
        light += (lowered * (1.3 + 0.15 * np.sin(x / 3)))[:, None]
    elif style == 2:
        for _ in range(8):
            a, b = rng.integers(0, _SIZE, 2)
            cv2.rectangle(
                light,
                (int(a), int(b)),
                (int(a + rng.integers(20, 160)), _SIZE),
                float(rng.uniform(0.3, 1.4)),
                -1,
            )
    return _paint((74, 76, 80), light)


def _rags(rng: np.random.Generator) -> UInt8Array:
    """Bright goods: boxes, fruit, folded cloth."""
    picture = np.full((_SIZE, _SIZE, 3), 60, np.uint8)
    for _ in range(420):
        x, y = (int(v) for v in rng.integers(-20, _SIZE, 2))
        w, h = (int(v) for v in rng.integers(14, 60, 2))
        cv2.rectangle(
            picture,
            (x, y),
            (x + w, y + h),
            [float(v) for v in np.clip(rng.uniform(40, 200) + rng.normal(0, 22, 3), 10, 240)],
            -1,
        )
    return picture


def _wood(rng: np.random.Generator) -> UInt8Array:
    """One board, its grain along v: fine fibres and the long waves of the year rings."""
    fibre = _blur(rng.normal(size=(_SIZE, _SIZE)).astype(np.float32), 0.8, 60)
    bend = _blur(fractal_noise(rng, _SIZE, 2, 3), 6, 90)
    x = np.arange(_SIZE, dtype=np.float32) / _SIZE
    rings = np.sin(2 * np.pi * (7 * x[None] + 0.9 * bend / bend.std()))
    return _paint((178, 132, 84), 1 + 0.07 * fibre / fibre.std() + 0.09 * rings, 0.5 * rings)


def _cloth(rng: np.random.Generator) -> UInt8Array:
    """A plain weave, 64 threads across."""
    y, x = np.mgrid[0:_SIZE, 0:_SIZE].astype(np.float32) * (64 / _SIZE)
    over = (np.floor(x) + np.floor(y)) % 2
    thread = np.where(over > 0, np.abs(np.sin(np.pi * x)), np.abs(np.sin(np.pi * y)))
    light = 0.82 + 0.22 * thread + 0.05 * fractal_noise(rng, _SIZE, 6)
    return _paint((190, 188, 184), light.astype(np.float32))


def _wicker(rng: np.random.Generator) -> UInt8Array:
    """Willow rods woven in and out of upright stakes, 8 stakes across and 16 rods up."""
    y, x = np.mgrid[0:_SIZE, 0:_SIZE].astype(np.float32) / _SIZE
    row = np.floor(16 * y).astype(int)
    wave = np.cos(2 * np.pi * 4 * x + np.pi * (row % 2))
    across = np.abs(np.sin(np.pi * 16 * y)) ** 0.6
    tone = rng.normal(1, 0.1, 16).astype(np.float32)[row]
    stake = np.clip(1 - np.abs((8 * x) % 1 - 0.5) / 0.16, 0, 1) * (wave < -0.45)
    light = tone * across * (0.72 + 0.28 * wave) * (1 - stake) + 0.75 * stake
    fine = _blur(rng.normal(size=(_SIZE, _SIZE)).astype(np.float32), 14, 0.8)
    light = 0.25 + 0.85 * np.clip(light, 0, 1.2) + 0.05 * fine / fine.std()
    return _paint((170, 124, 74), light.astype(np.float32))


def _road(rng: np.random.Generator) -> UInt8Array:
    """Asphalt of a driven road: fine grain, faint clouds, a few thin cracks and a mended strip."""
    size = 1024
    # stones of all sizes: what a camera sees of a road is rough at each distance
    light = 1 + 0.21 * fractal_noise(rng, size, 96, 4, 1.0) + 0.04 * fractal_noise(rng, size, 3)
    if rng.random() < 0.5:
        x, y = (int(v) for v in rng.integers(80, size - 300, 2))
        w, h = (int(v) for v in rng.integers(60, 220, 2))
        light[y : y + h, x : x + w] *= rng.uniform(0.85, 0.95)
    for _ in range(rng.integers(0, 4)):
        path = _wander(rng, size, 50, 7)
        cv2.polylines(light, [path], False, float(rng.uniform(0.55, 0.75)), 1, cv2.LINE_AA)
    return _paint((104, 103, 102), light, fractal_noise(rng, size, 4, 3) * 0.12)


def _marking(rng: np.random.Generator) -> UInt8Array:
    """Road paint, worn in places so that the asphalt shows."""
    size = _SIZE
    worn = fractal_noise(rng, size, 6, 6, 0.75) + float(rng.uniform(-1.6, -0.4))
    share = np.clip(worn * 2.5, 0, 0.85)[..., None]
    paint = _paint((214, 213, 206), 1 + 0.05 * fractal_noise(rng, size, 24, 4))
    bare = _paint((96, 95, 94), 1 + 0.12 * rng.normal(size=(size, size)).astype(np.float32))
    return _bytes(paint * (1 - share) + bare * share)


def _strokes(
    rng: np.random.Generator,
    picture: UInt8Array,
    colours: NDArray[np.floating],
    each: int,
    length_px: float,
) -> None:
    """Short strokes at random places and in random directions, tiling: ``each`` of every colour (n, 3)."""
    size = len(picture)
    for colour in colours:
        turn = rng.uniform(0, 2 * np.pi, each)
        reach = length_px * rng.uniform(0.4, 1.2, each)
        start = rng.uniform(0, size, (each, 2))
        end = start + np.stack([np.cos(turn), np.sin(turn)], 1) * reach[:, None]
        lines = np.stack([start, end], axis=1)
        for shift in ((0, 0), (size, 0), (0, size), (size, size)):
            whole = np.rint(lines - shift).astype(np.int32)
            cv2.polylines(picture, list(whole), False, [float(v) for v in colour], 2, cv2.LINE_AA)


def _lawn(rng: np.random.Generator) -> UInt8Array:
    """Blades of grass from above, green and dry, in patches, with a few small flowers."""
    size, n = 1024, 240
    dry = fractal_noise(rng, size, 3, 5)
    picture = np.empty((size, size, 3), np.uint8)
    picture[:] = (60, 70, 36)
    tone = rng.uniform(0.55, 1.3, (n, 1))
    dead = rng.random((n, 1)) < 0.2
    colours = np.array([102.0, 114.0, 64.0]) * tone + np.array([40.0, 18.0, 12.0]) * dead
    _strokes(rng, picture, colours, 110, 18.0)
    for _ in range(int(rng.integers(0, 26))):
        x, y = (int(v) for v in rng.integers(0, size, 2))
        cv2.circle(picture, (x, y), int(rng.integers(2, 4)), (200, 200, 186), -1, cv2.LINE_AA)
    light = np.clip(1 + 0.05 * dry, 0.7, 1.3)[..., None]
    warm = np.clip(dry, 0, 2)[..., None] * np.array([10.0, 5.0, -2.0])
    return _bytes(picture * light + warm)


def _foliage(rng: np.random.Generator) -> UInt8Array:
    """Leaves close together, lit from above, with small gaps."""
    picture = np.empty((_SIZE, _SIZE, 3), np.uint8)
    picture[:] = (46, 60, 26)
    n = 1500
    for i in range(n):
        shade = (0.62 + 0.45 * i / n) * rng.uniform(0.75, 1.2)
        colour = [float(min(255.0, c * shade)) for c in (104 + 26 * rng.random(), 128, 58)]
        centre = rng.integers(0, _SIZE, 2)
        axes = (int(rng.integers(8, 20)), int(rng.integers(4, 9)))
        turn = float(rng.uniform(0, 180))
        for shift in ((0, 0), (_SIZE, 0), (0, _SIZE)):
            at = (int(centre[0] - shift[0]), int(centre[1] - shift[1]))
            cv2.ellipse(picture, at, axes, turn, 0, 360, colour, -1, cv2.LINE_AA)
    return picture


def _pane(rng: np.random.Generator) -> UInt8Array:
    """A window by day: a dark room, a curtain or a blind, and the other side of the street mirrored."""
    size = 256
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / size
    light = 0.16 + 0.05 * fractal_noise(rng, size, 3)
    style = int(rng.integers(5))
    if style == 0:  # curtains at both sides
        side = np.minimum(x, 1 - x) < rng.uniform(0.12, 0.3)
        light = np.where(side, 0.75 + 0.16 * np.sin(x * 90), light)
    elif style == 1:  # a blind, lowered in part
        light = np.where(y < rng.uniform(0.15, 0.75), 0.8 + 0.07 * np.sin(y * 180), light)
    elif style == 2:  # net curtains
        light = light + 0.4 + 0.07 * np.sin(x * 60 + 3 * y)
    # roofs of the houses opposite: sky above them, their dark fronts below
    steps = np.interp(x[0], np.linspace(0, 1, 5), rng.uniform(0.15, 0.6, 5))
    sky = np.clip((steps[None] - y) * 14, 0, 1)
    light = light + 0.55 * sky * rng.uniform(0.5, 1.0)
    tinted = light[..., None] * np.array([118.0, 122.0, 128.0])
    return _bytes(tinted + sky[..., None] * np.array([8.0, 16.0, 30.0]))


_PAINTERS: dict[str, Callable[[np.random.Generator], UInt8Array]] = {
    "asphalt": _asphalt,
    "slabs": _slabs,
    "cobbles": _cobbles,
    "bricks": _bricks,
    "plaster": _plaster,
    "concrete": _concrete,
    "grass": _grass,
    "leaves": _leaves,
    "bark": _bark,
    "planks": _planks,
    "corrugated": _corrugated,
    "shutter": _shutter,
    "rust": _rust,
    "roof": _roof,
    "curtain": _curtain,
    "goods": _rags,
    "wood": _wood,
    "cloth": _cloth,
    "wicker": _wicker,
    "road": _road,
    "lawn": _lawn,
    "foliage": _foliage,
    "marking": _marking,
    "pane": _pane,
}
TEXTURE_KINDS = tuple(_PAINTERS)


@lru_cache(maxsize=160)
def texture(kind: str, variant: int) -> UInt8Array:
    """The sRGB texture (h, w, 3) of a kind in TEXTURE_KINDS; the same variant is always the same picture.

    Kept per process: painting takes longer than rendering with it.
    """
    rng = np.random.default_rng([TEXTURE_KINDS.index(kind), variant])
    picture = _PAINTERS[kind](rng)
    picture.setflags(write=False)
    return picture


_WORDS = (
    "AUTOHAUS", "MARKET", "BAKERY", "SALE", "FRESH", "PIZZA", "HOTEL", "CAFE", "TAXI", "BOOKS", "FLOWERS",
    "NEW", "DRIVE", "0 %", "TRANSPORT", "LOGISTICS", "EXPRESS", "KIOSK", "BANK", "MOTORS", "GARAGE", "SPORT",
)  # fmt: skip


def lettering(rng: np.random.Generator, width_px: int, height_px: int, words: int = 1) -> UInt8Array:
    """A printed strip, shape (height, width, 3): bold words on a plain ground."""
    ground = rng.integers(20, 245, 3)
    ink = np.where(ground.mean() > 128, rng.integers(0, 70, 3), rng.integers(190, 255, 3))
    picture = np.empty((height_px, width_px, 3), np.uint8)
    picture[:] = ground
    text = " ".join(rng.choice(_WORDS, words, replace=False))
    thickness = max(1, height_px // 16)
    (w, h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, thickness)
    scale = min(0.9 * width_px / w, 0.62 * height_px / h)
    at = (int((width_px - w * scale) / 2), int((height_px + h * scale) / 2))
    cv2.putText(
        picture, text, at, cv2.FONT_HERSHEY_DUPLEX, scale, [float(v) for v in ink], thickness, cv2.LINE_AA
    )
    return picture
