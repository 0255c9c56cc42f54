"""Pictures of the localisation study: sheets of placements, several cars at once, a reconstruction."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from recon.arrays import UInt8Array
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
from rescore.studies.localization.scores import Score, markdown_table
from rescore.studies.localization.study import LocalizationStudy, Tally
from rescore.studies.localization.trials import Trial

_SHOWN, _WORST = 40, 12
"""Placements in the pictures of the first and of the worst ones."""
_TYPICAL_OVERLAP = 0.88
"""The reconstruction that is drawn is the one nearest to it."""


def write_localization(study: LocalizationStudy, out: Path, jobs: Workers) -> Tally:
    """Run the trials of the study, and write ``localization.md`` and the pictures to a folder.

    Pictures are drawn while trials are done, since the photographs are too large to be kept.
    """
    tally, sheets = Tally(), _Sheets(study)
    for trial in study.trials(jobs):
        tally.add(trial)
        sheets.add(trial)
    with atomic_path(out / "localization.md") as beside:
        beside.write_text(markdown_table(tally.by_car))
    sheets.save(out)
    _save_several(study, out / "table.png")
    return tally


@dataclass(eq=False)
class _Sheets:
    """Small pictures of all trials, and a large one of a typical one."""

    study: LocalizationStudy
    tiles: list[tuple[float, UInt8Array]] = field(default_factory=list)
    """How bad, and the picture."""
    typical: tuple[float, UInt8Array, Instance3DView] | None = None
    """How far from typical, the picture, and what it shows."""

    def add(self, trial: Trial) -> None:
        """Take what is kept of a trial."""
        camera = TableCamera(self.study.seen_from)
        view, own = _view(trial, self.study), trial.scores["3dp"]
        self.tiles.append((_badness(trial), tile(trial.crop_rgb, trial.crop_xy_px, view, camera)))
        if not isinstance(own, Score) or own.overlap is None:
            return
        off = abs(own.overlap - _TYPICAL_OVERLAP)
        if self.typical is None or off < self.typical[0]:
            self.typical = (off, draw(trial.crop_rgb, trial.crop_xy_px, [view], camera, 3.0), view)

    def save(self, out: Path) -> None:
        """Write the sheets and the reconstruction."""
        first = sheet([picture for _, picture in self.tiles[:_SHOWN]], 5)
        save_png(out / "placements.png", titled(first, f"First {min(len(self.tiles), _SHOWN)} placements"))
        worst = sheet([t for _, t in sorted(self.tiles, key=lambda t: -t[0])[:_WORST]], 4)
        save_png(out / "worst.png", titled(worst, f"The worst {min(len(self.tiles), _WORST)} placements"))
        if self.typical is not None:
            save_reconstruction(out / "reconstruction.png", self.typical[1], self.typical[2])


def _badness(trial: Trial) -> float:
    """How bad the joint fit is: centroid error in mm, lost ones first."""
    own = trial.scores["3dp"]
    return own.centroid_mm + 2 * own.orientation_deg if isinstance(own, Score) else float("inf")


def _view(trial: Trial, study: LocalizationStudy) -> Instance3DView:
    own = trial.scores["3dp"]
    name = f"{trial.index} {trial.shape_id}"
    if not isinstance(trial.fit, FitLocalization) or not isinstance(own, Score):
        reason = "lost" if isinstance(own, Score) else str(own.reason)
        return Instance3DView(trial.truth, None, (), np.zeros((0, 3, 3)), f"{name} {reason}")
    numbers = f"{100 * (own.overlap or 0):.0f}% {own.centroid_mm:.1f}mm {own.orientation_deg:.1f}deg"
    parts = study.parts_m(trial.fit)
    return Instance3DView(
        trial.truth, trial.fit.box, study.part_labels, parts, f"{name} {numbers}", trial.ring_px
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
