"""The page on frames left out by place: the detector, the rescorer, and D fitted on the other places."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from reports.pages import write_figure, write_page
from reports.palette import BLUE, DARK_GREY, GREEN
from reports.run.tables import Table, interval_text, number_text
from reports.studies.false_positives import draw_false_positives
from rescore.results.candidate_file import ALONE
from rescore.results.sweep_file import SweptInterval
from rescore.studies.leave_one_out import (
    AS_IT_IS,
    FITTED,
    RECALLS,
    PlaceFacts,
    PlacesResult,
    write_places,
)

NAMES = {ALONE: "detector alone", AS_IT_IS: "rescorer as it is", FITTED: "D fitted on other places"}
_LOOKS = {ALONE: (DARK_GREY, "s"), AS_IT_IS: (BLUE, "o"), FITTED: (GREEN, "D")}
_NAMED = 6
"""Image ids of a place that its row names one by one."""


def write_places_study(result: PlacesResult, file: Path) -> Path:
    """Write the numbers to a JSON file, and page and figure of the same name beside it; returns the page."""
    write_figure(file.with_suffix(".png"), draw_places(result), dpi=120)
    write_places(file, result)
    figure = file.with_suffix(".png").name
    return write_page(file.parent, places_page(result, figure), file.with_suffix(".md").name)


def figures_table(result: PlacesResult, short: bool = False) -> Table:
    """A row a way of scoring: area, average precision, false positives an image by recall.

    ``short`` leaves the intervals out, for a terminal of 80 columns.
    """

    def text(figure: SweptInterval, digits: int = 2) -> str:
        return number_text(figure.value, digits) if short else interval_text(figure, digits)

    rows = tuple(
        (
            NAMES[way],
            text(result.figures[way].area, 3),
            text(result.figures[way].average_precision, 3),
            *(text(result.figures[way].fppi[f"{recall:g}"]) for recall in RECALLS),
        )
        for way in NAMES
    )
    first, *others = (f"{recall:.0%}" for recall in RECALLS)
    head = ("scores", "area", "AP", f"FP/image {first}", *others)
    return Table("Every place left out in turn", head, rows)


def changes_table(result: PlacesResult) -> Table:
    """A row a pair of ways of scoring: times fewer false positives by recall, change of average precision."""
    rows = tuple(
        (
            f"{NAMES[one.after]}, against {NAMES[one.before]}",
            *(interval_text(one.change.factor[f"{recall:g}"]) for recall in RECALLS),
            interval_text(one.change.average_precision, 3),
        )
        for one in result.comparisons
    )
    head = ("what is compared", *(f"at {recall:.0%}" for recall in RECALLS), "AP gained")
    return Table("Times fewer false positives", head, rows)


def places_table(result: PlacesResult) -> Table:
    """A row a place: its frames, cars and candidates, and what is left to fit on."""
    rows = tuple(
        (
            _frames(place),
            f"{len(place.image_ids)}",
            f"{place.n_cars}",
            f"{place.n_candidates}",
            f"{place.n_cars_of_others} of {place.n_others}",
        )
        for place in result.places
    )
    head = ("image ids", "frames", "cars", "candidates", "cars among the others' candidates")
    return Table("Places", head, rows)


def _frames(place: PlaceFacts) -> str:
    ids = place.image_ids
    return ", ".join(map(str, ids)) if len(ids) <= _NAMED else f"{ids[0]} to {ids[-1]}"


def places_sentence(result: PlacesResult) -> str:
    """How many places there are, and how large they are."""
    largest, alone = result.largest, sum(len(place.image_ids) == 1 for place in result.places)
    return (
        f"{result.n_images} frames with {result.n_cars} annotated cars are of {len(result.places)} places; "
        f"the largest has {len(largest.image_ids)} frames with {largest.n_cars} cars, {alone} have one frame."
    )


def draw_places(result: PlacesResult) -> Figure:
    """False positives an image over recall, with intervals."""
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    ax = figure.subplots()
    draw_false_positives(ax, {NAMES[way]: (result.figures[way].fppi, *_LOOKS[way]) for way in NAMES})
    ax.set_ylabel("false positives an image")
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def places_page(result: PlacesResult, figure: str) -> str:
    """The page in Markdown; its picture lies beside it."""
    evidence = np.array([result.figures[way].with_evidence for way in (AS_IT_IS, FITTED)])
    parts = [
        "# D fitted on labelled frames, every place left out in turn",
        f"Made by `{result.command}`: {result.n_candidates} candidates of {result.detector}. "
        f"{places_sentence(result)}",
        "Frames of one place share points of the scene and may show the same cars, so they are left out "
        "together. D of mode instance is fitted to the candidates in the frames of all other places, as if "
        "half of them were cars, and applied to those of the place; eq. 7 has the rescorer's w "
        f"({result.w:.2f}). The candidates of all places are ranked together. {evidence[0]:.0%} of them have "
        f"depth evidence with the rescorer as it is, {evidence[1]:.0%} with D fitted. In brackets intervals "
        "of 95 % from a bootstrap over frames; frames of one place are alike, so that they are rather too "
        "narrow.",
        f"![False positives an image by the share of cars found]({figure})",
        "Area under the ROC of candidates, average precision (AP), and false positives an image where a "
        "share of all cars is found.",
        figures_table(result).markdown().rstrip(),
        "## Times fewer false positives",
        "Paired over frames; above 1 the first makes fewer.",
        changes_table(result).markdown().rstrip(),
        "## Places",
        places_table(result).markdown().rstrip(),
    ]
    return "\n\n".join(parts) + "\n"
