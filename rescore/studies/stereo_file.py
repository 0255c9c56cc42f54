"""What the study of measured disparity found, as typed values, and the file stereo.json that holds it."""

from pathlib import Path
from typing import Self

from recon.stereo.accuracy import DisparityError
from rescore.files import versions, write_json
from rescore.results.sweep_file import StudyNumber, StudyPart
from rescore.studies.stereo import Accuracy, Consistency, Method, StereoStudy


class PublicFigure(StudyPart):
    """What others published of OpenCV's SGBM on a benchmark's test pictures, in per cent."""

    pictures: str
    density: float | None
    wrong_measured: float | None
    """Share of the measured pixels that are wrong, in per cent."""
    wrong_seen_twice: float
    """Share of the pixels seen in both pictures that are wrong after filling holes, in per cent."""
    wrong_all: float
    """Share of all pixels that are wrong after filling holes, in per cent."""
    source: str


PUBLIC = (
    PublicFigure(
        pictures="KITTI 2015 test, OCV-SGBM, D1-all",
        density=None,
        wrong_measured=5.86,
        wrong_seen_twice=9.47,
        wrong_all=10.86,
        source="KITTI's stereo 2015 table, entry OCV-SGBM (benchmark: Menze and Geiger, CVPR 2015), as it "
        "was in June 2019: D1-bg 8.92 %, D1-fg 20.59 %, D1-all 10.86 % of all pixels",
    ),
    PublicFigure(
        pictures="KITTI 2012 test, OCV-SGBM, over 3 px",
        density=86.50,
        wrong_measured=None,
        wrong_seen_twice=7.64,
        wrong_all=9.13,
        source="Geiger, Lenz and Urtasun, Are we ready for autonomous driving?, CVPR 2012, table 2",
    ),
)


class ErrorShares(StudyPart):
    """Error of a disparity map over some pixels; NaN where a share has none."""

    n_truth: int
    """Pixels with truth."""
    n_measured: int
    """Pixels with truth that have a measurement."""
    density: StudyNumber
    """Share of the pixels with truth that have a measurement."""
    end_point_error_px: StudyNumber
    """Mean absolute difference over the measured pixels."""
    wrong_share_measured: StudyNumber
    """Wrong pixels over measured pixels."""
    wrong_share_filled: StudyNumber
    """Wrong pixels over those with truth after filling holes from the background."""


def error_shares(error: DisparityError) -> ErrorShares:
    """The shares that follow from counts."""
    return ErrorShares(
        n_truth=error.n_truth,
        n_measured=error.n_measured,
        density=error.density,
        end_point_error_px=error.end_point_error_px,
        wrong_share_measured=error.wrong_share_measured,
        wrong_share_filled=error.wrong_share_filled,
    )


class MeasuredWhere(StudyPart):
    """What a row of errors is of."""

    measured_by: Method
    pixels: str
    """A region of ``rescore.studies.stereo.regions``."""
    rule: str
    """A name of ``rescore.studies.stereo.RULES``."""


# fields of the last base come first in the file
class MethodError(ErrorShares, MeasuredWhere):
    """Error of one method in one region by one rule."""


class KnownPairs(StudyPart):
    """Pairs with truth: one, or several added up."""

    name: str
    num_disparities: tuple[int, ...]
    """Numbers of disparities that were searched, each once, rising."""
    n_pairs: int
    n_pixels: int
    n_pixels_unlike_same_call: int
    """Pixels on which ``rescore`` and the same OpenCV call differ."""
    n_pixels_right_of_margin: int
    """Pixels right of the columns that OpenCV leaves empty without the margin."""
    n_pixels_right_of_margin_unlike_bare_call: int
    """Pixels right of the margin that only one of ``rescore`` and OpenCV without it measures, or that differ
    by more than a pixel."""
    errors: tuple[MethodError, ...]

    @classmethod
    def of(cls, one: Accuracy) -> Self:
        """The figures of a measurement, without its maps."""
        return cls(
            name=one.name,
            num_disparities=tuple(sorted(set(one.num_disparities))),
            n_pairs=len(one.num_disparities),
            n_pixels=one.n_pixels,
            n_pixels_unlike_same_call=one.n_unlike,
            n_pixels_right_of_margin=one.n_beyond,
            n_pixels_right_of_margin_unlike_bare_call=one.n_beyond_unlike,
            errors=tuple(
                MethodError(measured_by=method, pixels=region, rule=rule, **dict(error_shares(error)))
                for (method, region, rule), error in one.errors.items()
            ),
        )


class PairWithoutTruth(StudyPart):
    """What can be said of a pair without truth, fields as in ``rescore.studies.stereo.Consistency``."""

    name: str
    num_disparities: int
    density: float
    density_bare: float
    n_unlike: int
    at_limit: float
    features: ErrorShares
    """The map against the disparity of matched features."""

    @classmethod
    def of(cls, one: Consistency) -> Self:
        """The figures of a pair."""
        return cls(
            name=one.name,
            num_disparities=one.num_disparities,
            density=one.density,
            density_bare=one.density_bare,
            n_unlike=one.n_unlike,
            at_limit=one.at_limit,
            features=error_shares(one.features),
        )


class StereoResult(StudyPart):
    """The content of stereo.json."""

    command: str
    """What made it."""
    nearest_m: float
    """Depth from which calibrated pairs were measured."""
    opencv: str | None
    """Version of OpenCV; None where it is not known."""
    known_disparity: tuple[KnownPairs, ...]
    without_truth: tuple[PairWithoutTruth, ...]
    public: tuple[PublicFigure, ...]


def stereo_result(study: StereoStudy, command: str, nearest_m: float) -> StereoResult:
    """The figures of a study beside public ones."""
    return StereoResult(
        command=command,
        nearest_m=nearest_m,
        opencv=versions().get("opencv-python-headless"),
        known_disparity=tuple(KnownPairs.of(one) for one in study.known),
        without_truth=tuple(PairWithoutTruth.of(one) for one in study.without_truth),
        public=PUBLIC,
    )


def write_stereo(path: Path, result: StereoResult) -> None:
    """Write stereo.json."""
    write_json(path, result.as_json())
