"""The page on measured disparity: against the truth, OpenCV called directly, and public figures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from recon.stereo.accuracy import DisparityError
from reports.pages import write_figure, write_page
from reports.run.candidate_panels import colourise
from reports.run.tables import Table, number
from rescore.studies.stereo import MAX_ROW_PX, RULES, Accuracy, Consistency, Errors, Method, StereoStudy
from rescore.studies.stereo_file import PublicFigure, StereoResult, write_stereo

KITTI_REGIONS = ("background", "foreground")
_ERROR_LIMIT_PX = 4.0
_FIGURE_WIDTH_PX = 700


def write_stereo_study(study: StereoStudy, result: StereoResult, folder: Path) -> Path:
    """Write the page with its figure and numbers; returns the page.

    Args:
        study: what was measured.
        result: the figures of the study, as the file of numbers is to hold them.
        folder: where the files go.
    """
    if study.scenes:
        write_figure(folder / "maps.png", draw_maps(study.scenes))
    write_stereo(folder / "stereo.json", result)
    return write_page(folder, _page(study, result))


def short_tables(study: StereoStudy) -> list[Table]:
    """What fits a terminal of 80 columns: pairs with truth, KITTI's beside public figures, pairs without."""
    tables = [short_table(study.known)] if study.known else []
    tables += [kitti_table(study.kitti)] if study.kitti else []
    return tables + ([consistency_table(study.without_truth, short=True)] if study.without_truth else [])


def accuracy_table(known: Sequence[Accuracy]) -> Table:
    """A row a pair, region and method: density, errors of what is measured, errors with holes filled."""
    errors = ("mean error, px", "bad 1.0", "bad 2.0", "D1", "filled: bad 2.0", "filled: D1")
    head = ("pair", "pixels", "measured by", "density", *errors)
    rows = [
        (one.name, region, method.value, *_cells(one.errors, method, region))
        for one in known
        for region in dict.fromkeys(r for _, r, _ in one.errors)
        for method in Method
    ]
    return Table("Pairs with known disparity", head, tuple(rows), text_columns=3)


def _cells(errors: Errors, method: Method, region: str) -> list[str]:
    d1, bad_2, bad_1 = (errors[method, region, rule] for rule in RULES)
    measured = [_percent(e.wrong_share_measured) for e in (bad_1, bad_2, d1)]
    filled = [_percent(e.wrong_share_filled) for e in (bad_2, d1)]
    return [_percent(d1.density), number(d1.end_point_error_px, 2), *measured, *filled]


def short_table(known: Sequence[Accuracy]) -> Table:
    """What fits a terminal of 80 columns: all pixels."""
    rows = [
        (one.name, method.value, *_cells(one.errors, method, "all")) for one in known for method in Method
    ]
    head = ("pair", "by", "density", "px", "bad 1", "bad 2", "D1", "filled", "D1")
    return Table("Known disparity, all pixels; filled: bad 2 and D1", head, tuple(rows), text_columns=2)


def kitti_table(kitti: Accuracy) -> Table:
    """KITTI's own table: D1 of background, foreground and all, for each method."""
    rows = []
    for method in Method:
        for pixels, name in (("all", "All"), ("seen twice", "Noc")):
            found = [
                kitti.errors[method, f"{pixels}{ground}", "D1"]
                for ground in (*(f", {g}" for g in KITTI_REGIONS), "")
            ]
            rows.append((method.value, f"{name} / All", *(_percent(e.wrong_share_filled) for e in found), ""))
            shares = (_percent(e.wrong_share_measured) for e in found)
            rows.append((method.value, f"{name} / Est", *shares, _percent(found[-1].density)))
    head = ("measured by", "pixels", "D1-bg", "D1-fg", "D1-all", "density")
    return Table(kitti.name, head, tuple(rows), text_columns=2)


def beside_public_table(study: StereoStudy, public: Sequence[PublicFigure]) -> Table:
    """What the project measures beside what others published, by KITTI's rule."""
    rows = []
    for one in study.known:
        everywhere, twice = (one.errors[Method.OURS, region, "D1"] for region in ("all", "seen twice"))
        shares = (everywhere.density, everywhere.wrong_share_measured)
        filled = (twice.wrong_share_filled, everywhere.wrong_share_filled)
        rows.append((f"{one.name}, rescore, D1", *map(_percent, (*shares, *filled))))
    if study.without_truth:
        density = float(np.mean([c.density for c in study.without_truth]))
        name = f"{len(study.without_truth)} pairs without truth (below), rescore"
        rows.append((name, _percent(density), "not known", "", ""))
    for p in public:
        cells = (p.density, p.wrong_measured, p.wrong_seen_twice, p.wrong_all)
        rows.append((p.pictures, *("" if v is None else f"{v:.2f} %" for v in cells)))
    head = ("pictures", "density", "wrong, measured", "wrong, filled, seen twice", "wrong, filled, all")
    return Table("Beside public figures", head, tuple(rows))


def consistency_table(pairs: Sequence[Consistency], short: bool = False) -> Table:
    """Table of the pairs without truth, a row a pair, and all of them together; fits 80 columns."""
    rows = [
        (
            c.name,
            str(c.num_disparities),
            _percent(c.density),
            _percent(c.density_bare),
            _percent(c.at_limit),
            *_feature_cells(c.features),
        )
        for c in pairs
    ]
    means = [float(np.mean([getattr(c, n) for c in pairs])) for n in ("density", "density_bare", "at_limit")]
    total = sum((c.features for c in pairs), DisparityError())
    rows.append(("all", "", *map(_percent, means), *_feature_cells(total)))
    to_features = ("features", "of these measured", "mean difference, px", "D1 to features")
    head = ("pair", "disparities", "density", "without margin", "at the limit", *to_features)
    if short:
        head = ("pair", "range", "density", "bare", "limit", "features", "found", "px", "D1")
    return Table("Pairs without truth", head, tuple(rows))


def _feature_cells(e: DisparityError) -> tuple[str, ...]:
    wrong = _percent(e.wrong_share_measured)
    return str(e.n_truth), _percent(e.density), number(e.end_point_error_px, 2), wrong


def draw_maps(scenes: Sequence[Accuracy]) -> Figure:
    """Measured disparity and its error of each scene; grey where there is none, or no truth."""
    figure = Figure(figsize=(10, 3.9 * len(scenes)), layout="constrained")
    axes = figure.subplots(len(scenes), 2, squeeze=False)
    for row, one in zip(axes, scenes, strict=True):
        assert one.ours_px is not None
        assert one.truth_px is not None
        low, high = (float(v) for v in np.nanpercentile(one.truth_px, [1, 99]))
        error = one.ours_px - one.truth_px
        _draw(row[0], one.ours_px, (low, high), "viridis", f"{one.name}: measured disparity, px")
        limits = (-_ERROR_LIMIT_PX, _ERROR_LIMIT_PX)
        _draw(row[1], error, limits, "RdBu", f"{one.name}: measured less true, px")
    return figure


def _draw(ax: Axes, values: np.ndarray, limits: tuple[float, float], colours: str, title: str) -> None:
    # every so many pixels: a mean would mix surfaces at their edges
    step = max(1, values.shape[1] // _FIGURE_WIDTH_PX)
    ax.imshow(colourise(values[::step, ::step], *limits, colours), interpolation="nearest")
    ax.set_title(title, loc="left", fontsize=11)
    ax.set_axis_off()
    scale = ScalarMappable(Normalize(*limits), colours)
    ax.figure.colorbar(scale, ax=ax, fraction=0.04, pad=0.01)


def _percent(share: float) -> str:
    return "" if np.isnan(share) else f"{share:.2%}".replace("%", " %")


def _page(study: StereoStudy, result: StereoResult) -> str:
    scenes, kitti, without_truth, known = study.scenes, study.kitti, study.without_truth, study.known
    parts = ["# Measured disparity", f"Made by `{result.command}`.", _same(known, without_truth)]
    if known:
        about = f"{_KNOWN_TEXT} {_SCENES_TEXT}" if scenes else _KNOWN_TEXT
        parts += ["## Against the truth", about, accuracy_table(known).markdown().rstrip()]
    if kitti:
        parts += [
            f"KITTI's table, {len(kitti.num_disparities)} pairs:",
            kitti_table(kitti).markdown().rstrip(),
        ]
    if scenes:
        parts += ["![Measured disparity and its error](maps.png)", _MAPS_TEXT]
    beside = beside_public_table(study, result.public)
    parts += ["## Beside public figures", _PUBLIC_TEXT, beside.markdown().rstrip()]
    parts.append("Sources:\n\n" + "\n".join(f"- {p.pictures}: {p.source}." for p in result.public))
    if kitti is None:
        parts.append(_NO_TRUTH)
    if without_truth:
        parts += [
            "## Pairs without truth",
            _consistency_text(result.nearest_m),
            consistency_table(without_truth).markdown().rstrip(),
        ]
    return "\n\n".join(parts) + "\n"


def _same(known: Sequence[Accuracy], without_truth: Sequence[Consistency]) -> str:
    """Whether OpenCV called directly gives the same, and what the margin does."""
    unlike = sum(k.n_unlike for k in known) + sum(c.n_unlike for c in without_truth)
    n = sum(len(k.num_disparities) for k in known) + len(without_truth)
    result = "on every pixel" if unlike == 0 else f"but for {unlike} pixels"
    text = (
        "`rescore` measures disparity by OpenCV's StereoSGBM, and equals the same call made directly "
        f"{result} of {n} pairs. The same call: both pictures grey, with a margin on the left of as many "
        "columns as there are disparities, which repeats the first column; matches inside the margin are "
        "dropped. Without the margin OpenCV leaves that many columns on the left empty."
    )
    beyond = sum(k.n_beyond for k in known)
    if beyond:
        share = sum(k.n_beyond_unlike for k in known) / beyond
        text += (
            " On the other columns of the pairs with truth, the two differ by more than a pixel, or only "
            f"one of them measures, on {_percent(share)} of the pixels: the paths of the matcher start "
            "elsewhere."
        )
    return text


_KNOWN_TEXT = (
    "Shares of wrong pixels. Bad 1.0 and 2.0: off by more than 1 and 2 pixels (Middlebury); D1: by more "
    "than 3 pixels and 5 % of the truth (KITTI 2015). Density: measured pixels of those with truth. Mean "
    "error, bad and D1 are of measured pixels. Filled: of all pixels with truth, holes filled from the "
    "background as KITTI does, with the smaller of the two measured neighbours in the row. Seen twice: "
    "not hidden in the right picture; where a scene has no mask, by its truth alone. Middlebury scenes "
    "are searched up to their largest true disparity, which that benchmark tells. All other settings are "
    "those for rendered streets; nothing was tuned on these pairs."
)
_SCENES_TEXT = (
    "Aloe is the pair of Debian's opencv-doc (Middlebury 2006, true disparity in whole pixels), "
    "motorcycle that of scikit-image 0.16 (Middlebury 2014, reduced four times by means of 4 x 4 pixels), "
    "so neither is an entry of Middlebury's table."
)
_MAPS_TEXT = (
    "Grey: no measurement, or no truth. Right: red where measured too far, blue where too near. The "
    "pictures themselves are Middlebury's and are not copied here."
)
_PUBLIC_TEXT = (
    "Wrong by KITTI's rules, holes filled from the background. The public figures are of other pictures, "
    "streets under the sky, with other settings, so they tell the order of magnitude and no more. Density "
    "of pairs without truth is of whole pictures, sky and the columns without a partner among them. No "
    "figure of OpenCV's SGBM in Middlebury's table is quoted, since none could be checked."
)
_NO_TRUTH = (
    "KITTI's true disparities were not at hand, so there is no D1 on KITTI here. With KITTI stereo 2015, "
    "`rescore study-stereo data_scene_flow/training --out runs/stereo` gives D1-bg, D1-fg and D1-all of "
    "all pixels (All) and of those seen twice (Noc), with holes filled (All) and of measured pixels "
    "(Est), counted as that benchmark counts them."
)


def _consistency_text(nearest_m: float) -> str:
    return (
        f"With the preset: surfaces from {nearest_m:g} m on, by the calibrations. At the limit: pixels at "
        "the end of the search, which may be nearer than it reaches. Features: SIFT features that choose "
        f"each other in the two pictures, on rows at most {MAX_ROW_PX:g} pixel apart; their disparity is "
        "compared with the map at the nearest pixel. They lie where there is texture, so the share of "
        "wrong ones is smaller than that by truth would be; it would show a search that is too short or a "
        "pair that is not rectified."
    )
