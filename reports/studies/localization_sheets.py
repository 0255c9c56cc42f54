"""Pictures of the localisation study: sheets of placements, several cars at once, a reconstruction."""

from pathlib import Path

import numpy as np

from recon.errors import Failure
from recon.files import atomic_path
from recon.localization.localize import FitLocalization
from recon.localization.standing_box import StandingBox, angle_between
from reports.studies.localization_pictures import (
    Instance3DView,
    TableCamera,
    draw,
    save_png,
    save_reconstruction,
    sheet,
    tile,
    titled,
)
from rescore.engines.executor import Workers
from rescore.studies.localization.kept_trials import KeptTrials
from rescore.studies.localization.result_file import outside_remark
from rescore.studies.localization.scores import Score, markdown_table
from rescore.studies.localization.study import LocalizationStudy, Tally, scored
from rescore.studies.localization.trials import Trial, run_trial

_SHOWN, _WORST = 40, 12
"""Placements in the pictures of the first and of the worst ones."""
_TYPICAL_OVERLAP = 0.88
"""The reconstruction that is drawn is the one nearest to it."""


def write_localization(study: LocalizationStudy, out: Path, jobs: Workers) -> Tally:
    """Run the trials of the study that the folder does not hold, and write ``localization.md`` and pictures.

    Each trial is kept with its small picture when it is done: photographs are too large to be kept, and a run
    that was stopped goes on where it was.
    """
    kept, camera = study.kept(out), TableCamera(study.seen_from)
    for trial in study.trials(kept.missing(study.placements), jobs):
        picture = tile(trial.crop_rgb, trial.crop_xy_px, _view(trial, study), camera)
        kept.add(trial.index, scored(trial), picture)
    tally = Tally(kept.rows(study.placements))
    with atomic_path(out / "localization.md") as beside:
        beside.write_text(f"{markdown_table(tally.by_car)}\n{outside_remark(tally.placements)}\n")
    _save_sheets(kept, tally, out)
    _save_typical(study, tally, out / "reconstruction.png")
    _save_several(study, out / "table.png")
    return tally


def _save_sheets(kept: KeptTrials, tally: Tally, out: Path) -> None:
    """The first placements, and those with the largest errors."""
    count = len(tally.placements)
    first = sheet(kept.tiles(range(min(count, _SHOWN))), 5)
    save_png(out / "placements.png", titled(first, f"First {min(count, _SHOWN)} placements"))
    order = sorted(range(count), key=lambda i: -_badness(tally.placements[i].methods["3dp"]))[:_WORST]
    worst = sheet(kept.tiles(order), 4)
    save_png(out / "worst.png", titled(worst, f"The worst {len(order)} placements"))


def _save_typical(study: LocalizationStudy, tally: Tally, path: Path) -> None:
    """The reconstruction of the placement of typical overlap, tried once more; none where all are lost."""
    overlaps = [(i, p.methods["3dp"]) for i, p in enumerate(tally.placements)]
    off = {
        i: abs(s.overlap - _TYPICAL_OVERLAP)
        for i, s in overlaps
        if isinstance(s, Score) and s.overlap is not None
    }
    if not off:
        return
    index = min(off, key=lambda i: off[i])
    car = study.cars[index % len(study.cars)]
    trial = run_trial(car, index, study.table_class, study.config, study.seed)
    view, camera = _view(trial, study), TableCamera(study.seen_from)
    picture = draw(trial.crop_rgb, trial.crop_xy_px, [view], camera, 3.0)
    save_reconstruction(path, picture, view, _in_words(trial))


def _in_words(trial: Trial) -> str:
    """What became of a placement, as the title of its figure."""
    own, where = trial.scores["3dp"], f"{trial.shape_id}, placement {trial.index}"
    if not isinstance(own, Score):
        return f"{where}: lost ({own.reason})"
    return (
        f"{where}: boxes share {100 * (own.overlap or 0):.0f} %, their middles are {own.centroid_mm:.1f} mm "
        f"apart, their noses {own.orientation_deg:.1f} degrees"
    )


def _badness(own: Score | Failure) -> float:
    """How bad the joint fit is: centroid error in mm, lost ones first."""
    return own.centroid_mm + 2 * own.orientation_deg if isinstance(own, Score) else float("inf")


def _view(trial: Trial, study: LocalizationStudy) -> Instance3DView:
    own = trial.scores["3dp"]
    name = f"{trial.index} {trial.shape_id}"
    if not isinstance(trial.fit, FitLocalization) or not isinstance(own, Score):
        reason = "lost" if isinstance(own, Score) else str(own.reason)
        return Instance3DView(trial.truth, None, (), np.zeros((0, 3, 3)), f"{name}\n{reason}")
    numbers = f"{100 * (own.overlap or 0):.0f}% {own.centroid_mm:.1f}mm {own.orientation_deg:.1f}deg"
    if trial.fit.outside:
        numbers += " outside"
    if trial.fit.nose is not None:
        numbers += f" nose {100 * trial.fit.nose.probability:.0f}%"
    parts = study.parts_m(trial.fit)
    return Instance3DView(
        trial.truth, trial.fit.box, study.part_labels, parts, f"{name}\n{numbers}", trial.ring_px
    )


def _save_several(study: LocalizationStudy, path: Path) -> None:
    """One photograph of several cars with the boxes that the joint fit finds."""
    several = study.several()
    views = [
        Instance3DView(
            _nearest([p.box for p in several.placed], fit.box),
            fit.box,
            study.part_labels,
            study.parts_m(fit),
            "",
            region.ring_px,
        )
        for region, fit in several.found
    ]
    turned = [angle_between(v.truth.yaw_rad, v.estimate.yaw_rad) for v in views if v.estimate is not None]
    wrong = sum(angle > np.pi / 2 for angle in turned)
    title = f"{len(several.placed)} cars, {len(views)} found, {wrong} turned the wrong way; thick: the front"
    picture = draw(several.rgb, (0, 0), views, TableCamera(study.seen_from), 1.0)
    save_png(path, titled(picture, title))


def _nearest(boxes: list[StandingBox], to: StandingBox) -> StandingBox:
    return min(boxes, key=lambda box: float(np.linalg.norm(box.xy_m - to.xy_m)))
