"""A toy detection problem: a drawn wheel pattern, planted at known sizes on a textured ground."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np

from rescore.data.frames import DataSet, FrameRecord, Truth

WIDTH_PX, HEIGHT_PX = 320, 240
ASPECT = 2.75  # of the pattern: that of the HOG detector's object (88 x 32)
ASPECT_OF_END = 1.25


def draw_car(picture, x0, y0, width):
    """Draw the pattern, nose to the left, and return its box."""
    height = width / ASPECT

    def at(u, v):
        return round(x0 + u * width), round(y0 + v * height)

    outline = np.array(
        [
            at(0.0, 0.75),
            at(0.05, 0.4),
            at(0.3, 0.35),
            at(0.45, 0.0),
            at(0.85, 0.0),
            at(1.0, 0.45),
            at(1.0, 0.8),
        ]
    )
    cv2.fillPoly(picture, [outline], 200)
    cv2.fillPoly(picture, [np.array([at(0.36, 0.37), at(0.47, 0.08), at(0.8, 0.08), at(0.88, 0.4)])], 60)
    for u in (0.2, 0.8):
        cv2.circle(picture, at(u, 0.8), round(0.2 * height), 20, -1)
        cv2.circle(picture, at(u, 0.8), max(1, round(0.09 * height)), 160, -1)
    return [x0, y0, x0 + width, y0 + height]


def draw_end(picture, x0, y0, width):
    """Draw a pattern of another shape, as if seen from the nose, and return its box."""
    height = width / ASPECT_OF_END

    def at(u, v):
        return round(x0 + u * width), round(y0 + v * height)

    for (u0, v0, u1, v1), grey in (
        ((0.0, 0.4, 1.0, 0.85), 200),
        ((0.15, 0.0, 0.85, 0.4), 200),
        ((0.2, 0.08, 0.8, 0.38), 60),
        ((0.05, 0.8, 0.25, 1.0), 20),
        ((0.75, 0.8, 0.95, 1.0), 20),
    ):
        cv2.rectangle(picture, at(u0, v0), at(u1, v1), grey, -1)
    return [x0, y0, x0 + width, y0 + height]


def toy_picture(rng, cars):
    """A textured street (h, w) with crates and patterns (x0, y0, width), and the boxes of the patterns."""
    return picture_of(rng, [partial(draw_car, x0=x0, y0=y0, width=width) for x0, y0, width in cars])


def picture_of(rng, drawings):
    """A textured street (h, w) with crates and what is drawn on it, and the boxes of the drawings."""
    coarse = rng.uniform(70, 150, (HEIGHT_PX // 16, WIDTH_PX // 16)).astype(np.float32)
    picture = cv2.resize(coarse, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC)
    for _ in range(4):
        x, y = int(rng.integers(0, WIDTH_PX - 60)), int(rng.integers(0, HEIGHT_PX - 40))
        w, h = (int(v) for v in rng.integers(10, 60, 2))
        cv2.rectangle(picture, (x, y), (x + w, y + h), float(rng.uniform(20, 220)), -1)
    boxes = [draw(picture) for draw in drawings]
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7) + rng.normal(0, 4, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8), np.array(boxes, dtype=float).reshape(-1, 4)


def random_car(rng):
    """Place and size of a pattern inside the picture."""
    width = float(np.exp(rng.uniform(np.log(65), np.log(180))))
    return (
        float(rng.uniform(10, WIDTH_PX - 10 - width)),
        float(rng.uniform(10, HEIGHT_PX - 10 - width / ASPECT)),
        width,
    )


def toy_dataset(root: Path, n: int, seed: int) -> DataSet:
    """Pictures of one pattern each, on disk."""
    rng = np.random.default_rng(seed)
    frames, truth = [], {}
    for i in range(n):
        picture, boxes = toy_picture(rng, [random_car(rng)])
        path = root / f"{i:03d}.png"
        cv2.imwrite(str(path), picture)
        frames.append(FrameRecord(i, path, None, None, "train", WIDTH_PX, HEIGHT_PX, None, None))
        truth[i] = Truth(np.array([i]), boxes, np.array([False]), np.array([1.0]), ("",))
    return DataSet(root, 1, "car", tuple(frames), truth)


def random_view(rng):
    """A pattern of one of three views at a place and size, as a function that draws it, and its azimuth.

    Seen from the left its nose is to the left; from the right it is the mirrored pattern; or from the nose.
    """
    azimuth_deg = float(rng.choice([0.0, 90.0, 270.0]))
    height = float(np.exp(rng.uniform(np.log(26), np.log(60))))
    width = height * (ASPECT_OF_END if azimuth_deg == 0 else ASPECT)
    x0, y0 = float(rng.uniform(10, WIDTH_PX - 10 - width)), float(rng.uniform(10, HEIGHT_PX - 10 - height))
    draw = {0.0: draw_end, 90.0: draw_car, 270.0: _draw_mirrored}[azimuth_deg]
    return partial(draw, x0=x0, y0=y0, width=width), azimuth_deg


def _draw_mirrored(picture, x0, y0, width):
    flipped = np.ascontiguousarray(picture[:, ::-1])
    draw_car(flipped, WIDTH_PX - x0 - width, y0, width)
    picture[:] = flipped[:, ::-1]
    return [x0, y0, x0 + width, y0 + width / ASPECT]


def toy_views(root: Path, n: int, seed: int) -> DataSet:
    """Pictures of one pattern each, of one of three views with its azimuth, on disk."""
    rng = np.random.default_rng(seed)
    frames, truth = [], {}
    for i in range(n):
        draw, azimuth_deg = random_view(rng)
        picture, boxes = picture_of(rng, [draw])
        path = root / f"{i:03d}.png"
        cv2.imwrite(str(path), picture)
        frames.append(FrameRecord(i, path, None, None, "train", WIDTH_PX, HEIGHT_PX, None, None))
        azimuth = np.array([azimuth_deg])
        truth[i] = Truth(np.array([i]), boxes, np.array([False]), np.array([1.0]), ("",), azimuth)
    return DataSet(root, 1, "car", tuple(frames), truth)
