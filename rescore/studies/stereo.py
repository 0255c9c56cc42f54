"""How good measured disparity is: against the truth, against OpenCV called directly, against features.

The project's ``compute_disparity`` is OpenCV's StereoSGBM on a pair with a margin on the left. Here the same
call is written out again, with the margin and without.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, UInt8Array
from recon.errors import RescoreError
from recon.stereo.accuracy import BAD_1, BAD_2, D1, DisparityError, WrongRule, disparity_error, fill_holes
from recon.stereo.features import match_pair
from recon.stereo.sgbm import KITTI_SGBM, SgbmConfig, compute_disparity, disparities_beyond
from rescore.data.frames import DataSet, FrameRecord
from rescore.data.pictures import read_rgb
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.settings import automatic_stereo, stereo_for
from rescore.formats.open import read_dataset
from rescore.formats.stereo_truth import TruePair, TrueScene, TrueScenes, find_true_scenes
from rescore.speech import say

RULES: Mapping[str, WrongRule] = {"D1": D1, "bad_2": BAD_2, "bad_1": BAD_1}
"""What is called wrong, by name."""


class Method(StrEnum):
    """Ways to measure disparity with the same settings of StereoSGBM."""

    OURS = "rescore"
    """``recon.stereo.sgbm.compute_disparity``, as all commands call it."""
    SAME_CALL = "same call"
    """OpenCV on the grey pictures with a margin on the left, and what has no match dropped."""
    BARE_CALL = "no margin"
    """OpenCV on the grey pictures as they are: the first columns have no disparity."""


def same_call(left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> Float32Array:
    """Float32Array in pixels (h, w), NaN where there is none, by OpenCV on a pair with a margin on the left.

    The margin repeats the first column as often as there are disparities. Matches inside it are dropped.
    """
    n = config.num_disparities
    margin = [np.concatenate([np.repeat(g[:, :1], n, axis=1), g], axis=1) for g in _grey(left_rgb, right_rgb)]
    disparity = _sgbm(config, *margin)[:, n:]
    outside = np.arange(left_rgb.shape[1])[None] < disparity
    return np.where(outside, np.float32(np.nan), disparity)


def bare_call(left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> Float32Array:
    """Float32Array in pixels (h, w), NaN where there is none, by OpenCV on a pair as it is."""
    return _sgbm(config, *_grey(left_rgb, right_rgb))


def _grey(left_rgb: UInt8Array, right_rgb: UInt8Array) -> tuple[UInt8Array, UInt8Array]:
    left, right = (np.asarray(cv2.cvtColor(p, cv2.COLOR_RGB2GRAY), np.uint8) for p in (left_rgb, right_rgb))
    return left, right


def _sgbm(config: SgbmConfig, left: UInt8Array, right: UInt8Array) -> Float32Array:
    matcher = cv2.StereoSGBM.create(
        0,
        config.num_disparities,
        config.block_size,
        config.p1,
        config.p2,
        config.left_right_max_difference,
        config.pre_filter_cap,
        config.uniqueness_percent,
        config.speckle_window,
        config.speckle_range,
        cv2.STEREO_SGBM_MODE_SGBM,
    )
    sixteenths = matcher.compute(left, right)
    return np.where(sixteenths > 0, sixteenths / np.float32(16), np.float32(np.nan)).astype(np.float32)


METHODS: Mapping[Method, Callable[[UInt8Array, UInt8Array, SgbmConfig], Float32Array]] = {
    Method.OURS: compute_disparity,
    Method.SAME_CALL: same_call,
    Method.BARE_CALL: bare_call,
}

Errors = dict[tuple[Method, str, str], DisparityError]
"""Errors of disparity by method, region and name of the rule of ``RULES``."""


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of the methods on one pair or, added up, on several."""

    name: str
    num_disparities: tuple[int, ...]
    """Number of disparities that were searched, one for each pair."""
    n_pixels: int
    """Number of pixels of the left pictures."""
    n_unlike: int
    """Pixels on which ``rescore`` and the same OpenCV call differ."""
    n_beyond: int
    """Pixels right of the columns that OpenCV leaves empty without the margin."""
    n_beyond_unlike: int
    """Pixels counted in ``n_beyond`` that only one of ``rescore`` and OpenCV without the margin measures, or
    that differ by more than a pixel."""
    errors: Errors
    ours_px: Float32Array | None = None
    """The disparity of one pair by ``Method.OURS``; None of several."""
    truth_px: Float32Array | None = None
    """True disparity of one pair; None of several."""


def regions(pair: TruePair) -> dict[str, BoolArray]:
    """Masks (h, w) of a pair by name: all pixels, those seen in both pictures; KITTI's also by ground."""
    everywhere = np.ones(pair.truth_px.shape, bool)
    grounds = {"": everywhere}
    if pair.foreground is not None:
        grounds |= {", background": ~pair.foreground, ", foreground": pair.foreground}
    return {
        f"{name}{ground}": seen & where
        for name, seen in (("all", everywhere), ("seen twice", pair.seen_twice))
        for ground, where in grounds.items()
    }


def matcher_of(pair: TruePair, kitti: bool, nearest_m: float) -> SgbmConfig:
    """The settings for a pair: KITTI's preset by its calibration, Middlebury's range from its truth.

    Middlebury tells the largest disparity of each scene to those who take part; so does this.
    """
    width = pair.truth_px.shape[1]
    if not kitti:
        return SgbmConfig(num_disparities=disparities_beyond(float(np.nanmax(pair.truth_px))))
    return KITTI_SGBM if pair.camera is None else stereo_for(width, [(pair.camera, 0.0)], nearest_m)


def accuracy(pair: TruePair, config: SgbmConfig) -> Accuracy:
    """The errors of every method on one pair, by region and rule."""
    maps = {method: measure(pair.left_rgb, pair.right_rgb, config) for method, measure in METHODS.items()}
    filled = {method: fill_holes(disparity) for method, disparity in maps.items()}
    errors = {
        (method, region, rule): disparity_error(disparity, pair.truth_px, mask, limits, filled[method])
        for region, mask in regions(pair).items()
        for method, disparity in maps.items()
        for rule, limits in RULES.items()
    }
    beyond, bare = (maps[m][:, config.num_disparities :] for m in (Method.OURS, Method.BARE_CALL))
    return Accuracy(
        pair.name,
        (config.num_disparities,),
        pair.truth_px.size,
        n_unlike(maps[Method.OURS], maps[Method.SAME_CALL]),
        beyond.size,
        n_unlike(beyond, bare, 1.0),
        errors,
        maps[Method.OURS],
        pair.truth_px,
    )


def accuracies(scenes: TrueScenes, nearest_m: float, jobs: Workers) -> Iterator[Accuracy]:
    """The errors on every pair of a folder, one after the other, each with the settings for it."""
    return map_frames(_accuracy_of, scenes.scenes, (scenes.kitti, nearest_m), jobs)


def _accuracy_of(scene: TrueScene, settings: tuple[bool, float]) -> Accuracy:
    pair = scene.load()
    return accuracy(pair, matcher_of(pair, *settings))


def added(name: str, several: Iterable[Accuracy]) -> Accuracy:
    """The errors over the pixels of several pairs, as KITTI adds them up; the maps are let go."""
    total: Errors = {}
    ranges: tuple[int, ...] = ()
    counts = np.zeros(4, int)
    for one in several:
        for key, error in one.errors.items():
            total[key] = total.get(key, DisparityError()) + error
        ranges += one.num_disparities
        counts += (one.n_pixels, one.n_unlike, one.n_beyond, one.n_beyond_unlike)
    n_pixels, unlike, n_beyond, beyond_unlike = (int(n) for n in counts)
    return Accuracy(name, ranges, n_pixels, unlike, n_beyond, beyond_unlike, total)


def n_unlike(a: Float32Array, b: Float32Array, within_px: float = 0.0) -> int:
    """Pixels on which two maps differ by more than so much; a hole is like another, and nothing else."""
    return int((~((np.abs(a - b) <= within_px) | (np.isnan(a) & np.isnan(b)))).sum())


@dataclass(frozen=True)
class Consistency:
    """What can be said of a pair without truth."""

    name: str
    num_disparities: int
    density: float
    """Share of the left picture with a disparity."""
    density_bare: float
    """Share of the left picture with a disparity by OpenCV called without the margin."""
    n_unlike: int
    """Pixels on which ``rescore`` and the same OpenCV call differ."""
    at_limit: float
    """Share of the picture at the end of the search, where things may be nearer than it reaches."""
    features: DisparityError = field(default_factory=DisparityError)
    """The map against the disparity of SIFT features matched between the pictures, taken for the truth."""


MAX_ROW_PX = 1.0
"""Features whose rows differ by more are matched wrongly; rows of a rectified pair are equal."""


def consistency(name: str, left_rgb: UInt8Array, right_rgb: UInt8Array, config: SgbmConfig) -> Consistency:
    """Density of a pair without truth, and how it agrees with SIFT features that pick each other."""
    ours = compute_disparity(left_rgb, right_rgb, config)
    bare = bare_call(left_rgb, right_rgb, config)
    return Consistency(
        name=name,
        num_disparities=config.num_disparities,
        density=float(np.isfinite(ours).mean()),
        density_bare=float(np.isfinite(bare).mean()),
        n_unlike=n_unlike(ours, same_call(left_rgb, right_rgb, config)),
        at_limit=float((ours >= config.num_disparities - 2).mean()),
        features=_against_features(ours, left_rgb, right_rgb),
    )


def _against_features(
    disparity_px: Float32Array, left_rgb: UInt8Array, right_rgb: UInt8Array
) -> DisparityError:
    """The map (h, w) against matched features on one row, at the pixel nearest to each."""
    matches = match_pair(left_rgb, right_rgb)
    good = (np.abs(matches.row_px) <= MAX_ROW_PX) & (matches.disparity_px > 0)
    truth = np.full(disparity_px.shape, np.nan, np.float32)
    column, row = np.rint(matches.left_uv_px[good]).astype(int).T
    truth[row, column] = matches.disparity_px[good]
    return disparity_error(disparity_px, truth, np.ones(truth.shape, bool))


def consistency_of(data: DataSet, nearest_m: float, jobs: Workers) -> Iterator[Consistency]:
    """The consistency of every pair of a data set, one after the other, with the settings of the commands."""
    shared = data.root.resolve().name, automatic_stereo(data, nearest_m)
    return map_frames(_consistency_of, (f for f in data.frames if f.right_path is not None), shared, jobs)


def _consistency_of(frame: FrameRecord, shared: tuple[str, SgbmConfig]) -> Consistency:
    folder, config = shared
    assert frame.right_path is not None, "pairs alone are given"
    left, right = (
        read_rgb(path, frame.width_px, frame.height_px) for path in (frame.left_path, frame.right_path)
    )
    return consistency(f"{folder} {frame.left_path.stem}", left, right, config)


@dataclass(frozen=True)
class StereoStudy:
    """What was measured on some folders of pairs."""

    scenes: tuple[Accuracy, ...] = ()
    """Pairs with truth, but for KITTI's."""
    kitti: Accuracy | None = None
    """All pairs of KITTI stereo 2015 together."""
    without_truth: tuple[Consistency, ...] = ()

    @property
    def known(self) -> tuple[Accuracy, ...]:
        """Everything with truth."""
        return (*self.scenes, *([self.kitti] if self.kitti else []))


def study_folders(folders: Sequence[Path], nearest_m: float, jobs: Workers) -> StereoStudy:
    """Measure every folder of pairs.

    Raises:
        RescoreError: a folder holds no pairs, or KITTI stereo 2015 comes twice.
    """
    study = StereoStudy()
    for folder in folders:
        found = find_true_scenes(folder)
        if found is None:
            more = tuple(consistency_of(_pairs_of(folder), nearest_m, jobs))
            study = replace(study, without_truth=study.without_truth + more)
        elif not found.kitti:
            study = replace(study, scenes=study.scenes + tuple(accuracies(found, nearest_m, jobs)))
        elif study.kitti is None:
            say(f"{folder}: KITTI stereo 2015, {len(found.scenes)} pairs")
            study = replace(study, kitti=added("KITTI 2015", accuracies(found, nearest_m, jobs)))
        else:
            raise RescoreError(f"{folder}: expected one folder of KITTI stereo 2015, got a second; give one")
    return study


def _pairs_of(folder: Path) -> DataSet:
    """A data set that has right pictures."""
    data = read_dataset(folder)
    for note in data.notes:
        say(f"note: {note}")
    if not any(frame.right_path for frame in data.frames):
        raise RescoreError(f"{folder}: expected pairs of pictures, got frames without right ones; give pairs")
    return data
