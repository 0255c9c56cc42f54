"""How a recording opens: its tabs and what each view shows."""

from collections.abc import Mapping

import rerun.blueprint as rrb

from reports.palette import NIGHT, NIGHT_SKY, detector_name, mode_name, rgb
from reports.recording.candidate import bars_view
from reports.recording.crop import CROP_HEIGHT_PX, CROP_WIDTH_PX
from reports.recording.entities import (
    FRAME_TIME,
    IMAGE,
    RIGHT_IMAGE,
    WORLD,
    boxes3d_path,
    boxes_path,
    crop_path,
    models_path,
    object_path,
    part,
    why_path,
)
from reports.recording.plot import Plot
from reports.recording.story import Story
from reports.recording.threshold import sheet_size_px, threshold_tab
from reports.run.curves import CARS, DrawnCurves, curve_charts, curve_sets
from rescore.results.candidate_file import ALONE

TABS = ("overview", "frame", "candidate", "threshold")
"""The tabs of the first detector; the tabs of further detectors follow."""


RECORDED = (CARS,)
"""The kinds of curves that a recording draws, of those of ``reports.run.curves``: a column each in the
overview. Operating points lie on ``CARS``."""

Plots = Mapping[str, Mapping[str, Plot]]
"""By kind of curve and detector."""


def recorded_plots(story: Story) -> Plots:
    """The curves of each detector in all its modes."""
    charts = curve_charts([DrawnCurves.of_mode(c) for c in curve_sets(story.run)], (story.run.metrics,))
    return {
        kind: {
            d: Plot(
                f"curves/{part(d)}/{kind.lower().replace(' ', '_')}",
                f"{detector_name(d, short=True)}: {kind.lower()}",
                chart,
            )
            for d, chart in charts[kind].items()
        }
        for kind in RECORDED
    }


def blueprint(
    story: Story,
    plots: Plots,
    size_px: tuple[int, int],
    n_frames: int,
    right: bool,
) -> rrb.Blueprint:
    """The blueprint of a recording.

    Args:
        story: the run.
        plots: what ``recorded_plots`` gives.
        size_px: width and height of the largest picture.
        n_frames: frames that are shown.
        right: whether there are right pictures.
    """
    first, *others = story.run.detectors
    sheet = sheet_size_px(size_px, n_frames)
    tabs = [
        _overview(plots),
        _frame_tab(story, first, size_px, right, TABS[1]),
        _candidate_tab(story, first, TABS[2]),
        threshold_tab(first, plots[CARS][first], sheet, TABS[3]),
    ]
    for d in others:
        name = detector_name(d, short=True)
        tabs += [
            _frame_tab(story, d, size_px, right, f"frame: {name}"),
            _candidate_tab(story, d, f"candidate: {name}"),
            threshold_tab(d, plots[CARS][d], sheet, f"threshold: {name}"),
        ]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(timeline=FRAME_TIME, state="collapsed", play_state="paused", fps=2),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def _overview(plots: Plots) -> rrb.Horizontal:
    """The guide beside the curves, two in a row, and after the last curve the table of results."""
    guide = rrb.TextDocumentView(origin="guide", name="how to read this recording")
    results = rrb.TextDocumentView(origin="results", name="results on the test set")
    cells = [*(plot.view() for own in plots.values() for plot in own.values()), results]
    # an odd number of cells leaves the last one a row of its own
    rows = [rrb.Horizontal(*cells[i : i + 2]) for i in range(0, len(cells), 2)]
    return rrb.Horizontal(guide, rrb.Vertical(*rows), column_shares=[2, 5], name=TABS[0])


def _frame_tab(
    story: Story, detector: str, size_px: tuple[int, int], right: bool, title: str
) -> rrb.Horizontal:
    main = story.mode_of(detector)
    before = _picture_view(story, detector, (ALONE,), ALONE, size_px, f"before: {mode_name(ALONE)}")
    columns = [before]
    if main != ALONE:
        others = tuple(m for m in story.modes_of(detector) if m != ALONE)
        columns.append(_picture_view(story, detector, others, main, size_px, f"after: {mode_name(main)}"))
    depths = [rrb.Spatial2DView(name="measured depth", origin=IMAGE, contents=[f"{IMAGE}/measured_depth/**"])]
    if right:
        depths.append(
            rrb.Spatial2DView(name="right picture", origin=RIGHT_IMAGE, contents=[f"{RIGHT_IMAGE}/right"])
        )
    side = rrb.Vertical(
        _scene_view(story, detector), rrb.Horizontal(*depths), _table_view(detector), row_shares=[6, 3.4, 4.6]
    )
    return rrb.Horizontal(rrb.Vertical(*columns), side, column_shares=[1, 1.15], name=title)


def _picture_view(
    story: Story,
    detector: str,
    modes: tuple[str, ...],
    shown: str,
    size_px: tuple[int, int],
    name: str,
) -> rrb.Spatial2DView:
    """A view of the boxes of some modes: one mode is shown, the others can be switched on."""
    paths = [boxes_path(detector, m) for m in modes]
    hidden = {boxes_path(detector, m): rrb.EntityBehavior(visible=False) for m in modes if m != shown}
    w, h = size_px
    bounds = rrb.VisualBounds2D(x_range=[-0.01 * w, 1.01 * w], y_range=[-0.02 * h, 1.1 * h])
    return rrb.Spatial2DView(
        name=name,
        origin=IMAGE,
        contents=[f"{IMAGE}/left", f"{IMAGE}/{part(detector)}/legend", *(f"{p}/**" for p in paths)],
        overrides=hidden,
        visual_bounds=bounds,
        background=rgb(NIGHT),
    )


def _table_view(detector: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(name="candidates of this frame", origin=f"tables/{part(detector)}")


def _scene_view(story: Story, detector: str) -> rrb.Spatial3DView:
    shown = "fitted cars as boxes" if story.shows_fits(detector) else "best three models, their boxes"
    return rrb.Spatial3DView(
        name=f"stereo points, {shown}",
        origin=WORLD,
        contents=[
            *(f"{WORLD}/stereo_points", f"{WORLD}/ground", IMAGE, f"{IMAGE}/left"),
            *(RIGHT_IMAGE, f"{models_path(detector)}/**", f"{boxes3d_path(detector)}/**"),
        ],
        background=rgb(NIGHT_SKY),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(-2.0, -2.4, 2.7), look_target=(0.6, 9.0, 0.7), eye_up=(0, 0, 1)
        ),
    )


def _candidate_tab(story: Story, detector: str, title: str) -> rrb.Horizontal:
    root = crop_path(detector)
    bounds = rrb.VisualBounds2D(x_range=[0, CROP_WIDTH_PX], y_range=[0, CROP_HEIGHT_PX])

    def crop(name: str, *contents: str) -> rrb.Spatial2DView:
        paths = [f"{root}/{c}" for c in contents]
        return rrb.Spatial2DView(
            name=name, origin=root, contents=paths, visual_bounds=bounds, background=rgb(NIGHT)
        )

    if story.shows_fits(detector):
        pictures = (
            crop("box; dashes: the car depth shows", "picture", "box", "car"),
            crop("measured depth", "measured_depth/**", "box", "car"),
            crop("the car depth shows", "seen_depth/**", "box", "car"),
            crop("the best-fitting car", "framed_depth/**", "box"),
            crop("measured − best-fitting car", "residual", "box"),
            _object_view(detector, "best-fitting car; white: the car depth shows"),
        )
    else:
        pictures = (
            crop("box and outline", "picture", "box", "outline"),
            crop("registered parts", "picture", "parts"),
            crop("measured depth", "measured_depth/**", "outline"),
            crop("predicted depth, registered", "predicted_depth/**", "outline"),
            crop("residual: measured − predicted", "residual", "outline"),
            _object_view(detector, "parts on the stereo points"),
        )
    crops = rrb.Grid(*pictures, grid_columns=2)
    words = rrb.TextDocumentView(origin=f"{why_path(detector)}/text", name="why it rose or fell")
    left = rrb.Vertical(words, bars_view(story, detector), row_shares=[5, 6])
    return rrb.Horizontal(left, crops, column_shares=[2, 3], name=title)


def _object_view(detector: str, name: str) -> rrb.Spatial3DView:
    root = object_path(detector)
    return rrb.Spatial3DView(
        name=name,
        # the frame on the ground before the candidate: the eye follows it
        origin=f"{root}/place",
        contents=[
            *(f"{WORLD}/stereo_points", f"{WORLD}/ground", f"{root}/**"),
        ],
        background=rgb(NIGHT_SKY),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=(-2.7, -4.2, 2.3), look_target=(0.0, 0.3, 0.6), eye_up=(0, 0, 1)
        ),
    )
