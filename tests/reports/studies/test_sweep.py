"""The pages on depth evidence say what their numbers say."""

from math import inf
from pathlib import Path

import cv2
import numpy as np
import pytest

from reports.studies.distractors import Example, distractor_text, draw_boxes, draw_examples
from reports.studies.evidence import ablation_sentence, evidence_text
from reports.studies.sweep import FIGURES, losses_text, sweep_text, write_sweep_page
from rescore.results.sweep_file import (
    SweepFigures,
    SweepPoint,
    SweepResult,
    SweptDial,
    SweptInterval,
    VisibilityGroup,
)
from rescore.studies.ablation import AblationRow
from rescore.studies.distractors import BankCut, BankKind, BankResult, Quartiles


def interval(value: float, low: float, high: float) -> SweptInterval:
    return SweptInterval(value=value, low=low, high=high, n_undefined=0, n_infinite=0)


def figures(fppi: float, factor: tuple[float, float, float] | None, loss: bool = False) -> SweepFigures:
    return SweepFigures(
        fppi=interval(fppi, 0.1, inf),
        auc=interval(0.9, 0.8, 0.95),
        reduction=factor and interval(*factor),
        with_evidence=1.0,
        significant_loss=loss,
    )


def sweep_value(loss: bool) -> SweepResult:
    def point(level: float, factor: tuple[float, float, float], lost: bool = False) -> SweepPoint:
        own = {"detector": figures(2.0, None), "metric": figures(0.5, factor, lost)}
        return SweepPoint(level=level, figures=own)

    points = (point(0.0, (4.0, 1.5, inf)), point(1.0, (0.5, 0.2, 0.8), loss))
    group = VisibilityGroup(visible=(0.3, 0.6), n_cars=7, figures=points[0].figures)
    dials = {"holes": SweptDial(what="share of holes", points=points)}
    return SweepResult(detector="hog", n_images=9, dials=dials, visibility=(group,))


def distractor_value() -> BankResult:
    def kind(name: str, d: tuple[float | None, ...], below: tuple[str, ...]) -> BankKind:
        return BankKind(
            name=name,
            title=f"a {name}",
            is_car=name == "car",
            count=len(d),
            distance_m=(10.0,) * len(d),
            d={"metric": Quartiles(low=0.1, median=0.25, high=0.5, without=d.count(None))},
            values={"metric": d},
            below_cars=below,
        )

    kinds = (kind("car", (0.2, 0.3), ()), kind("van", (0.1, None), ("metric",)))
    cut = {"metric": BankCut(posters=6.25, posters_dark=4.0, all=inf)}
    return BankResult(recall=0.7, cut=cut, kinds=kinds)


ABLATION = [
    AblationRow(without="nothing", n_cues=0, w=0.3, fppi=interval(0.5, 0.2, 0.9),
                auc=interval(0.97, 0.9, 0.99), factor=None),
    AblationRow(without="size", n_cues=3, w=0.4, fppi=interval(1.0, 0.4, 1.9),
                auc=interval(0.95, 0.9, 0.99), factor=interval(2.0, 1.2, inf)),
    AblationRow(without="fill", n_cues=6, w=0.4, fppi=interval(0.5, 0.4, 1.9),
                auc=interval(0.95, 0.9, 0.99), factor=interval(1.0, 0.7, 1.4)),
]  # fmt: skip


def test_the_page_of_a_sweep_has_curves_and_tables(tmp_path: Path) -> None:
    page = write_sweep_page(sweep_value(loss=True), tmp_path)
    text = page.read_text()
    for name in FIGURES:
        assert f"({name})" in text
        picture = cv2.imread(str(tmp_path / name))
        assert picture is not None
        # not one colour
        assert picture.std() > 5
    assert "| 1 | 2.00 | 0.50 | 0.50 [0.20, 0.80] *loss* | 0.900 | 0.900 |" in text
    assert "| 30% to 60% | 7 | 2.00 | 0.50 | 4.00 [1.50, inf] |" in text


@pytest.mark.parametrize("loss", [True, False])
def test_losses_are_named(loss: bool) -> None:
    text = losses_text(sweep_value(loss).dials)
    assert ("share of holes, level 1: metric, factor 0.50 [0.20, 0.80]" in text) == loss
    assert text.startswith("None") != loss
    assert text in sweep_text(sweep_value(loss))


def test_the_page_of_distractors_names_what_fools_it() -> None:
    text = distractor_text(distractor_value())
    assert "| a van | 2 | 0.25 [0.10, 0.50] | 1 |" in text
    assert "- metric: a van" in text
    assert "metric: posters 6.2 times, all distractors no distractor passes; posters where half" in text


def test_parts_are_called_needed_only_beyond_their_interval() -> None:
    assert "beyond the interval: size." in ablation_sentence(ABLATION)
    assert "Better without: none." in ablation_sentence(ABLATION)


def test_the_page_of_the_study_holds_everything() -> None:
    text = evidence_text("make it", distractor_value(), ABLATION, sweep_value(loss=True))
    for part in ("make it", "distractors.png", "examples.png", "sweep/reduction.png", "| fill | 6 |"):
        assert part in text
    assert "level 1: metric" in text


def test_boxes_and_examples_are_drawn(tmp_path: Path) -> None:
    draw_boxes(tmp_path / "boxes.png", distractor_value())
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[40:80, 50:110] = (0, 0, 90)
    disparity = np.full((120, 160), 3, np.float32)
    disparity[40:80, 50:110] = 9
    disparity[:10] = np.nan
    some = Example("a thing", "metric 0.5", picture, disparity, np.array([50.0, 40, 110, 80]))
    at_the_rim = Example("another", "", picture, disparity, np.array([0.0, 90, 160, 120]))
    draw_examples(tmp_path / "examples.png", [some, at_the_rim])
    assert cv2.imread(str(tmp_path / "boxes.png")).std() > 5
    sheet = cv2.imread(str(tmp_path / "examples.png"))
    # blue of the thing, brightened, in the picture; its disparity is another colour than what is around it
    assert (sheet[..., 0].astype(int) - sheet[..., 1] > 80).any()
