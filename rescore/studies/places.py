"""Frames of one place: left pictures that share points of the scene, so that they may show the same cars.

Points are SIFT's (Lowe 2004) with the square roots of their descriptors (Arandjelovic and Zisserman 2012).
Two points are the same where each is the other's nearest by far, and where one movement of the camera
explains both with many others. A picture is compared with those shortly before it in the order of the data
set, and what is connected is one place.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray, UInt8Array
from rescore.data.frames import DataSet, FrameRecord
from rescore.data.pictures import read_rgb
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread, track

POINTS = 2000
"""Points of a picture at most, the strongest ones."""
REACH = 3
"""Pictures before each that it is compared with."""
RATIO = 0.8
"""A nearest descriptor is a match where its distance is below this share of that of the second nearest."""
OFF_EPIPOLAR_PX = 1.5
"""Distance from the epipolar line up to which a pair of points agrees with a movement of the camera."""
MIN_SHARED = 10
"""Shared points from which two pictures show one place. It is low on purpose: frames of one street that are
parted would judge themselves, those of two that are joined only leave fewer to fit on. Of 116 pairs of road
pictures 15 or more frames apart two share so many by chance, nine at least nine: any seven pairs of points
fix a movement."""


@dataclass(frozen=True, eq=False)
class Points:
    """Points of a picture that can be found again in another."""

    xy_px: FloatArray
    """Shape (n, 2)."""
    descriptor: Float32Array
    """Shape (n, 128), of length 1."""


def places_of(data: DataSet, jobs: Workers) -> tuple[tuple[int, ...], ...]:
    """The image ids of the frames of each place, places and frames in the order of the data set.

    Args:
        data: frames; those of a street follow each other.
        jobs: pictures at a time; the result is the same for any number.

    Raises:
        RescoreError: a picture that cannot be read.
    """
    count = len(data.frames)
    found = map_frames(_points_of, data.frames, None, jobs)
    place = np.arange(count)
    before: deque[Points] = deque(maxlen=REACH)
    for k, points in enumerate(track(found, "places", count)):
        for back, other in enumerate(before, start=1):
            one, two = place[k - back], place[k]
            if one != two and shared_points(other, points) >= MIN_SHARED:
                place[place == two] = one
        before.appendleft(points)
    ids = np.array([frame.image_id for frame in data.frames])
    return tuple(tuple(ids[place == p].tolist()) for p in dict.fromkeys(place.tolist()))


def find_points(left_rgb: UInt8Array) -> Points:
    """The points of a picture (h, w, 3)."""
    grey = cv2.cvtColor(left_rgb, cv2.COLOR_RGB2GRAY)
    found, sift = cv2.SIFT_create(POINTS).detectAndCompute(grey, None)  # type: ignore[attr-defined]
    if not len(found):
        return Points(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    # square roots of shares: their Euclidean distance does not let a few large entries decide
    share = sift / np.maximum(sift.sum(axis=1, keepdims=True), 1e-9)
    return Points(np.array([p.pt for p in found]), np.sqrt(share).astype(np.float32))


def shared_points(one: Points, two: Points) -> int:
    """Number of points of two pictures that are the same and move as the camera does."""
    first, second = _matches(one.descriptor, two.descriptor)
    if len(first) < MIN_SHARED:
        return 0
    a, b = one.xy_px[first], two.xy_px[second]
    with one_thread():
        # its random numbers start anew in each call; its mask is not always filled
        matrix, _ = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, OFF_EPIPOLAR_PX, 0.99)
    if matrix is None or matrix.shape != (3, 3):
        return 0
    return int((_off_epipolar_px(np.asarray(matrix, float), a, b) <= OFF_EPIPOLAR_PX).sum())


def _points_of(record: FrameRecord, _shared: None) -> Points:
    with one_thread():
        return find_points(read_rgb(record.left_path, record.width_px, record.height_px))


def _matches(one: Float32Array, two: Float32Array) -> tuple[IntArray, IntArray]:
    """Rows of two sets of descriptors (n, 128), (m, 128) that are each other's nearest by far."""
    if min(len(one), len(two)) < MIN_SHARED:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    with one_thread():
        distance = np.sqrt(np.maximum(2 - 2 * (one @ two.T), 0))
    nearest, back = distance.argmin(axis=1), distance.argmin(axis=0)
    mutual = back[nearest] == np.arange(len(one))
    second = np.minimum(
        np.partition(distance, 1, axis=1)[:, 1], np.partition(distance, 1, axis=0)[1][nearest]
    )
    first = np.flatnonzero(mutual & (distance.min(axis=1) < RATIO * second))
    return first, nearest[first]


def _off_epipolar_px(matrix: FloatArray, one: FloatArray, two: FloatArray) -> FloatArray:
    """Larger distance of each of n pairs of points, (n, 2) each, from the epipolar line of the other."""
    a, b = np.c_[one, np.ones(len(one))], np.c_[two, np.ones(len(two))]
    line_in_two, line_in_one = a @ matrix.T, b @ matrix
    off = np.abs((b * line_in_two).sum(axis=1))
    shortest = np.minimum(np.hypot(*line_in_two[:, :2].T), np.hypot(*line_in_one[:, :2].T))
    return np.asarray(off / np.maximum(shortest, 1e-12))
