"""The page and the strips of section 5.2: ``python -m reports.studies.grasping RUN FOLDER COMMAND``.

Copies numbers and reduced strips of a finished ``rescore grasp`` and writes a page from the numbers.
"""

import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from recon.arrays import BoolArray, UInt8Array
from recon.errors import Failure
from recon.files import atomic_path
from reports.pages import write_figure, write_page
from reports.palette import BLUE, VERMILION
from rescore.grasping.basket import (
    HANDLE_BELOW_PALM_M,
    HANDLE_OPENING_M,
    OTHER,
    TAUGHT,
    VIEW_BINS,
    BasketResult,
    BasketTrial,
    basket_table,
    basket_trial,
    read_baskets,
    two_view_model,
)
from rescore.grasping.choose import GRIP_HEIGHT, MARGIN_M
from rescore.grasping.error_grid import KIND_NAME, LEVELS, ErrorGrid, error_table, read_errors
from rescore.grasping.experiment import Experiment
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import GENTLE_N, LIFTED_M, wilson
from rescore.grasping.perception import METHOD_NAME, METHODS
from rescore.grasping.pictures import strip
from rescore.grasping.result_file import (
    REPORTED_PLACEMENTS,
    GraspResult,
    GraspRow,
    by_car_table,
    grasp_table,
    read_grasps,
)
from rescore.grasping.trial import Replay, replay

_JPEG_QUALITY = 88
_PICTURES = (".png", ".jpg")
STRIPS = {
    "strip_grasp": "A grasp with three fingers after the joint fit, from the approach to the car put down",
    "strip_jaw": "The same trial with the parallel jaw",
    "recording": "A trial in the Rerun viewer (`--show`): orange the estimated box, green the true one",
    "strip_failed": "The first trial that fails after the joint fit; a car that breaks is taken away",
    "strip_single_plane": "The first trial that fails after the single plane with the hand wide open",
    "strip_narrow": "The first trial that fails after the single plane, opened by its own width",
}
BASKET_STRIPS = {
    "strip_basket": "The basket that taught the class model, taken by the handle that is hidden",
    "strip_basket_other": "Another basket, by the same class model",
    "basket_photo": "A photograph as the method gets it: a card hides every pixel of the handle",
}
"""Pictures of a run with what a person reads in their place."""


def write_grasping(experiment: Experiment, result: GraspResult, out: Path) -> None:
    """Write ``grasp.md`` and the strips of a finished experiment to a folder."""
    first = next(iter(HANDS))
    text = grasp_table(result) + "\nHeld / gently held placements of each car, three fingers:\n\n"
    with atomic_path(out / "grasp.md") as beside:
        beside.write_text(text + by_car_table(result, first))
    for name, row, method, hand in _shown(result):
        shown = replay(row, experiment.cars[row.index], experiment.seed, method, hand)
        _save(out / f"{name}.png", strip(shown.record, HANDS[hand], shown.mesh))


def show_trial(experiment: Experiment, result: GraspResult, number: int) -> Replay:
    """The trial of this number, carried out again after the joint fit with three fingers.

    Raises:
        RescoreError: there is no such trial, or it had no motion.
    """
    experiment.require_trial(number)
    row = result.rows[number]
    return replay(row, experiment.cars[row.index], experiment.seed, METHODS[0], next(iter(HANDS)))


def _shown(result: GraspResult) -> list[tuple[str, GraspRow, str, str]]:
    """Names of strips with the trial, method and hand that each shows; those without a trial are left out."""
    three, jaw = list(HANDS)[:2]
    held = next((r for r in result.rows if all(r.verdicts["3dp"][h].held for h in HANDS)), None)
    out = [] if held is None else [("strip_grasp", held, "3dp", three), ("strip_jaw", held, "3dp", jaw)]
    for name, method in (
        ("failed", "3dp"),
        ("single_plane", "single_plane"),
        ("narrow", "single_plane_narrow"),
    ):
        failed = next((r for r in result.rows if _moved_and_failed(r, method, three)), None)
        if failed is not None:
            out.append((f"strip_{name}", failed, method, three))
    return out


def _moved_and_failed(row: GraspRow, method: str, hand: str) -> bool:
    if method not in row.verdicts:
        return False
    verdict = row.verdicts[method][hand]
    # a refusal has words and no motion that could be shown
    return not verdict.held and not verdict.detail and not isinstance(row.estimates[method], Failure)


def write_basket_strips(result: BasketResult, out: Path) -> None:
    """Write a strip of each basket with the parallel jaw, and a photograph, to a folder."""
    model, jaw = two_view_model(), list(HANDS)[1]
    for name, basket in (("strip_basket", TAUGHT), ("strip_basket_other", OTHER)):
        held = [r for r in result.rows if r.basket == basket and r.verdicts[jaw].held]
        trial = basket_trial(basket, held[0].placement, model, result.seed, jaw) if held else None
        if isinstance(trial, BasketTrial):
            _save(out / f"{name}.png", strip(trial.record, HANDS[jaw], trial.shot.mesh))
            if basket == TAUGHT:
                _save(out / "basket_photo.png", _around(trial.shot.rgb, trial.shot.card))


def _around(rgb: UInt8Array, card: BoolArray) -> UInt8Array:
    """The part of a picture (h, w, 3) around the card that is in it."""
    rows, columns = np.nonzero(card)
    room = 160
    top, left = max(rows.min() - room, 0), max(columns.min() - room, 0)
    return np.asarray(rgb[top : rows.max() + room, left : columns.max() + room])


def draw_errors(grid: ErrorGrid) -> Figure:
    """Shares gently held (lines) and held at all (dashed) over each kind of error, a panel a kind."""
    figure = Figure(figsize=(11.0, 3.2), layout="constrained")
    axes = figure.subplots(1, len(LEVELS), sharey=True)
    for ax, kind in zip(axes, LEVELS, strict=True):
        for (key, hand), colour in zip(HANDS.items(), (BLUE, VERMILION), strict=True):
            points = grid.points_of(kind, key)
            x = [p.level for p in points]
            gentle = np.array([wilson(p.gentle, p.trials) for p in points])
            ax.fill_between(x, gentle[:, 0], gentle[:, 1], color=colour, alpha=0.12, linewidth=0)
            ax.plot(x, [p.gentle / p.trials for p in points], color=colour, marker="o", markersize=3)
            ax.plot(x, [p.held / p.trials for p in points], color=colour, linestyle="--", linewidth=1)
            ax.plot([], [], color=colour, marker="o", markersize=3, label=f"{hand.name}, gently held")
            ax.plot([], [], color=colour, linestyle="--", linewidth=1, label=f"{hand.name}, held")
        ax.set_xlabel(f"error {KIND_NAME[kind]}")
        ax.set_ylim(-0.03, 1.03)
    axes[0].set_ylabel("share of trials")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def _save(path: Path, rgb: UInt8Array) -> None:
    with atomic_path(path) as beside:
        beside.write_bytes(cv2.imencode(".png", rgb[..., ::-1])[1].tobytes())


_WHAT = f"""## What is done

A car stands on the black table of the localisation study within reach of an arm, is photographed by the
calibrated camera, segmented, and localised by every method. From the estimated box alone a grasp from above
across the width is chosen: the hand is opened by the estimated width plus {1000 * MARGIN_M:.0f} mm (half on
each side), its pads go down to {GRIP_HEIGHT:g} of the estimated height where palm and fingers stay clear of
the estimated top. Inverse kinematics gives the joint angles along a straight line of 20 cm down to the
grasp, RRT-Connect a way to its top that touches neither table nor estimated box. The hand closes, lifts
20 cm, holds 2 s, shakes 1.5 s at 2 Hz and puts down. Nothing that happens in the engine changes the motion.

*Held*: at the end of lift, hold and shake the car is at least {100 * LIFTED_M:.0f} cm above where it stood,
and both sides of the hand touch it. *Gently*: before the hand closed it pushed the car with less than
{GENTLE_N:.0f} N. One car, the lowest one, is fragile: it breaks where one side presses with more than 40 N.
Every sixth car is thin. Intervals are Wilson's.

- *3DP, joint fit* and *the report's construction*: see the page on localisation. Front and rear are not
  told apart here, since the grasp needs neither.
- *Single plane*: it has no width. With the *hand wide open* the hand is opened as far as it goes, which is
  the kinder rule; *opened by its own width* takes the rule of the others at its word, with a width of
  nothing. Both rules were fixed before any trial on these cars.
- *True box*: what the hands do where nothing has to be estimated.

The arm has seven joints after the published kinematics of the WAM; the first hand three fingers after the
BarrettHand; the second is a parallel jaw of 140 mm. The engine is MuJoCo. The arm waits behind the table
and is not drawn in the camera's picture. Rules and limits were chosen on sixteen cars that are not among
these; these were looked at once, and nothing was changed after."""


def publish(run_dir: Path, folder: Path, command: str) -> Path:
    """Copy the numbers and strips of a run to a folder, with a page that shows them; returns the page.

    Args:
        run_dir: the folder of a finished ``rescore grasp``.
        folder: where to publish; made where it is missing.
        command: what made the run, for the page.

    Raises:
        RescoreError: no finished run there.
    """
    result = read_grasps(run_dir / "grasp.json")
    grid = read_errors(run_dir / "errors.json")
    baskets = read_baskets(run_dir / "basket.json")
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("grasp", "errors", "basket"):
        shutil.copyfile(run_dir / f"{name}.json", folder / f"{name}.json")
    write_figure(folder / "errors.png", draw_errors(grid), dpi=110)
    drawn = {n: f for n in (*STRIPS, *BASKET_STRIPS) for f in run_dir.glob(f"{n}.*") if f.suffix in _PICTURES}
    for name, file in drawn.items():
        picture = np.asarray(cv2.imread(str(file)))
        _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        with atomic_path(folder / f"{name}.jpg") as beside:
            beside.write_bytes(jpeg.tobytes())
    return write_page(folder, page(result, grid, baskets, command, tuple(drawn)))


def page(
    result: GraspResult, grid: ErrorGrid, baskets: BasketResult, command: str, drawn: Sequence[str]
) -> str:
    """The page from the numbers of ``grasp.json``, ``errors.json`` and ``basket.json``."""
    first = next(iter(HANDS))
    parts = [
        "# Grasping model cars (section 5.2 of the report)",
        f"Made by `{command}`: {len(result.cars)} cars, {result.placements} placements of each.\n"
        "`grasp.json` holds every trial.",
        *_tables(result),
        *_pictures(STRIPS, drawn),
        _WHAT,
        "## What fails\n\n" + "\n".join(_failures(result)),
        "## By car\n\nHeld / gently held, three fingers.\n\n" + by_car_table(result, first).rstrip(),
        _ERRORS,
        "![Success over errors of the estimate](errors.png)",
        error_table(grid).rstrip(),
        _BASKET,
        basket_table(baskets).rstrip(),
        *_pictures(BASKET_STRIPS, drawn),
    ]
    return "\n\n".join(parts) + "\n"


def _tables(result: GraspResult) -> list[str]:
    """The table of as many placements as the report has, and that of all where there are more."""
    few, first = result.first(REPORTED_PLACEMENTS), next(iter(HANDS))
    more = [m for m in METHODS if len(result.verdicts(m, first)) > len(few.verdicts(m, first))]
    if not more:
        return [grasp_table(result).rstrip()]
    return [
        f"The first {few.placements} placements of each car, as many as in the report:",
        grasp_table(few).rstrip(),
        f"All {result.placements} placements of each car, with the methods that were tried at all of them:",
        grasp_table(result, more).rstrip(),
    ]


def _pictures(names: Mapping[str, str], drawn: Sequence[str]) -> list[str]:
    return [f"![{text}]({name}.jpg)\n\n{text}." for name, text in names.items() if name in drawn]


_ERRORS = """## Which accuracy a grasp needs

The true box with an error of one kind, on eight cars that are not among those above. The line is the share
gently held with Wilson's interval, the dashed one the share held at all. Errors across the car count most:
half of the margin beside the car is what there is."""

_BASKET = f"""## A handle that the camera does not see

The class model is made of two part-labelled views of one basket (bins {VIEW_BINS[0]} and {VIEW_BINS[1]}).
In the photograph a card hides every pixel of the handle. The body is localised by the report's construction
from its convex outline, with its view bin given, as the report assumes it of the detector; the transform of
section 4.4 carries the handle over, and the hand comes down across its bar, opened by
{1000 * HANDLE_OPENING_M:.0f} mm, until the estimated top lies {1000 * HANDLE_BELOW_PALM_M:.0f} mm below the
palm. *Carried* counts baskets that were lifted and kept aloft; *held* also asks that both sides of the hand
touch the handle each time, which they do not where it hangs over closed fingers. Opening and depth were
chosen on other placements of the same two baskets."""


def _failures(result: GraspResult) -> list[str]:
    """A line for each hand that names the trials that the joint fit does not hold, or not gently."""
    lines = []
    for key, hand in HANDS.items():
        bad = [
            f"{row.car} {row.placement} ({v.cause.value if v.cause else f'pushed with {v.pushed_n:.0f} N'})"
            for row in result.rows
            if (v := row.verdicts["3dp"][key]).ending != "gentle"
        ]
        lines.append(f"- {METHOD_NAME['3dp']}, {hand.name}: {', '.join(bad) or 'nothing'}.")
    return lines


if __name__ == "__main__":
    print(publish(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
