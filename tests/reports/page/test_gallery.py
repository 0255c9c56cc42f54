import base64
from dataclasses import replace

import cv2
import numpy as np

from reports.page.gallery import build_gallery
from reports.run.candidate_panels import (
    PICTURE_WIDTH_PX,
    Picture,
    as_webp,
    candidate_panels,
    colour_stops,
    colourise,
    crop_window,
)
from reports.run.curves import match_table
from reports.run.fitted_cars import shown_area
from reports.run.frame_view import frame_views
from rescore.results.candidate_file import places
from rescore.results.changes import CHANGED, Group
from rescore.results.run_folder import Run


def pixels(picture: Picture) -> np.ndarray:
    head, data = picture.uri.split(",")
    assert head == "data:image/webp;base64"
    return cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_movers_are_the_largest_moves_of_the_right_kind(run: Run):
    gallery = build_gallery(run, "paper", max_cards=24)
    assert {m.detector for m in gallery.movers} == set(run.detectors)
    for m in gallery.movers:
        rows = run.of(m.detector)
        (i,) = np.flatnonzero((rows["image_id"] == m.image_id) & (rows["rank"] == m.view.rank))
        assert m.before == places(match_table(run, m.detector, "detector").ranking)[i]
        assert m.after == places(match_table(run, m.detector, "paper").ranking)[i]
        rose = m.after < m.before
        assert rose == ((m.view.outcome == "hit") == m.gain)
        assert m.view.posterior == rows["posterior_paper"][i]
        assert f"place {m.before} to {m.after} of {len(rows['rank'])}" in m.title
        assert ("rose" in m.title) == rose
        assert m.reason.startswith(f"D {m.view.depth_difference:.3f} (median")
        assert m.group_text


def test_what_counts_otherwise_comes_first_then_the_larger_move(run: Run):
    groups: dict[tuple, list] = {}
    for m in build_gallery(run, "paper").movers:
        key = m.group not in CHANGED, -abs(m.after - m.before)
        groups.setdefault((m.detector, m.gain, m.view.outcome), []).append(key)
    assert len(groups) >= 4
    assert all(keys == sorted(keys) for keys in groups.values())


def test_the_first_cards_show_one_of_each_kind(run: Run):
    movers = build_gallery(run, "paper", max_cards=16).movers
    kinds = [(m.detector, m.gain, m.view.outcome) for m in movers]
    assert len(set(kinds[: len(set(kinds))])) == len(set(kinds))
    assert len(movers) <= 16


def test_three_candidates_tell_most(run: Run):
    gallery = build_gallery(run, "paper")
    telling = gallery.telling
    assert len(telling) == len(set(map(id, telling))) == 3
    assert all(m in gallery.movers for m in telling)
    counting = [m for m in gallery.movers if m.group in CHANGED]
    fell = next(m for m in counting if m.gain and m.view.outcome == "false_alarm")
    assert telling[0] is fell
    losses = [m for m in counting if not m.gain]
    assert not losses or losses[0] in telling


def test_no_card_says_that_what_rose_is_gone_or_what_fell_is_new(run: Run):
    for m in build_gallery(run, "paper").movers:
        against = (Group.REJECTED_FALSE_ALARM, Group.LOST_CAR)
        other_way = (Group.ACCEPTED_FALSE_ALARM, Group.GAINED_CAR)
        assert m.group not in (against if m.after < m.before else other_way)
        assert "rejected" not in m.verdict


def test_a_false_alarm_on_a_car_is_called_badly_framed(run: Run):
    mover = build_gallery(run, "paper").movers[0]

    def title(outcome: str, kind: str) -> str:
        return replace(mover, view=replace(mover.view, outcome=outcome, kind=kind)).title.partition(" from")[
            0
        ]

    way = "rose" if mover.after < mover.before else "fell"
    assert title("false_alarm", "car") == f"False alarm (car, badly framed) {way}"
    assert title("false_alarm", "road_sign") == f"False alarm (road sign) {way}"
    assert title("hit", "car") == f"Hit {way}"
    assert title("duplicate", "car") == f"Duplicate {way}"


def test_colours_are_neutral_at_zero_residual_and_grey_in_holes():
    values = np.array([[-1.0, 0.0, 1.0, np.nan]], np.float32)
    colours = colourise(values, -1, 1, "RdBu").astype(int)
    assert np.ptp(colours[0, 1]) < 5
    assert colours[0, 1].min() > 240
    # nearer than predicted is red, farther is blue
    assert colours[0, 0, 0] > colours[0, 0, 2] + 50
    assert colours[0, 2, 2] > colours[0, 2, 0] + 50
    assert colours[0, 3].tolist() == [105, 105, 105]


def test_the_ramp_of_the_page_is_that_of_the_pictures():
    first, *_, last = colour_stops("viridis", 3).split(", rgb")
    ends = colourise(np.array([[0.0, 1.0]], np.float32), 0, 1)[0].tolist()
    assert first == "rgb({}, {}, {})".format(*ends[0])
    assert last == "({}, {}, {})".format(*ends[1])


def test_panels_are_pictures_of_the_candidate(run: Run):
    view = next(frame_views(run, "paper"))
    panels = candidate_panels(view, view.candidates["hog"][0])
    assert panels.picture.width_px == PICTURE_WIDTH_PX
    assert (panels.frame.width_px, panels.frame.height_px) == view.rgb.shape[1::-1]
    for picture in (panels.frame, panels.picture, panels.measured, panels.predicted, panels.residual):
        assert picture is not None
        shown = pixels(picture)
        assert shown.shape[:2] == (picture.height_px, picture.width_px)
        assert shown.std() > 3
    # the depth maps show the same part of the image
    assert panels.predicted is not None
    assert (panels.measured.width_px, panels.measured.height_px) == (
        panels.predicted.width_px,
        panels.predicted.height_px,
    )


def test_a_picture_is_given_back():
    picture = np.full((20, 30, 3), (200, 100, 50), np.uint8)
    assert np.abs(pixels(as_webp(picture)).astype(int) - picture).max() < 6


def test_what_is_cut_out_has_one_aspect_and_holds_the_box(run: Run):
    for view in frame_views(run, "paper"):
        for c in view.candidates["hog"]:
            measured = candidate_panels(view, c).measured
            rows, columns = crop_window(c.xyxy_px, view.measured.shape)
            assert measured.width_px % (columns.stop - columns.start) == 0
            h, w = rows.stop - rows.start, columns.stop - columns.start
            assert abs(w / h - 1.8) < 0.05 or w == view.measured.shape[1]
            x0, y0, x1, y1 = np.clip(c.xyxy_px, 0, [*view.measured.shape[1::-1]] * 2)
            assert columns.start <= x0
            assert x1 <= columns.stop
            assert rows.start <= y0
            assert y1 <= rows.stop


def test_cards_of_mode_instance_show_the_car_beside_the_measured_depth(instance_run: Run):
    view = next(frame_views(instance_run, "instance"))
    for c in view.candidates["hog"]:
        panels = candidate_panels(view, c)
        assert panels.of_fit == (c.fit is not None) == (panels.predicted is not None)
        assert c.view == ("" if c.fit is None else "seen from its left front (75 %), else from its rear")
        if c.fit is None or panels.predicted is None:
            continue
        rows, columns = crop_window(shown_area(c), view.measured.shape)
        # the window holds the end of the car, half a box beyond the box, and the dashes are white there
        end = min(c.fit.seen.silhouette_px[2], view.measured.shape[1])
        assert columns.start < c.xyxy_px[2] < end <= columns.stop
        shown = pixels(panels.picture).astype(int)
        zoom = shown.shape[1] / (columns.stop - columns.start)
        at = round((end - columns.start) * zoom)
        if at >= shown.shape[1] - 2:
            continue
        top, bottom = (round((y - rows.start) * zoom) for y in c.xyxy_px[[1, 3]])
        side = shown[max(top, 0) : bottom, at - 1 : at + 2].min(axis=2).max(axis=1)
        assert 0.2 < (side > 200).mean() < 0.8
    other = next(frame_views(instance_run, "paper"))
    assert not any(candidate_panels(other, c).of_fit for c in other.candidates["hog"])
