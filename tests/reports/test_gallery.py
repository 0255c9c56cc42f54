import base64

import cv2
import numpy as np

from reports.curves import match_table
from reports.gallery import build_gallery, places
from reports.pictures import PANEL_WIDTH_PX, colourise, data_uri
from reports.run_folder import Run


def test_places_count_from_the_best_and_keep_the_order_of_ties():
    assert places(np.array([0.2, 0.9, 0.2, 0.5])).tolist() == [3, 1, 4, 2]


def test_movers_are_the_largest_moves_of_the_right_kind(run: Run):
    for shelf in build_gallery(run, "paper", per_shelf=3):
        right = shelf.title.endswith("right moves")
        gains = []
        for m in shelf.movers:
            assert m.outcome in ("hit", "false_alarm")
            rose = m.after < m.before
            assert rose == ((m.outcome == "hit") == right)
            rows = run.of(m.detector)
            (i,) = np.flatnonzero((rows["image_id"] == m.image_id) & (rows["rank"] == m.rank))
            assert m.before == places(match_table(run, m.detector, "detector").ranking)[i]
            assert m.after == places(match_table(run, m.detector, "paper").ranking)[i]
            assert m.posterior == rows["posterior_paper"][i]
            assert str(m.before) in m.title
            assert ("rose" in m.title) == rose
            gains.append(abs(m.after - m.before))
        assert gains == sorted(gains, reverse=True)
        assert 1 <= len(gains) <= 3


def test_colours_are_neutral_at_zero_residual_and_grey_in_holes():
    values = np.array([[-1.0, 0.0, 1.0, np.nan]], np.float32)
    colours = colourise(values, -1, 1, "RdBu").astype(int)
    assert np.ptp(colours[0, 1]) < 5
    assert colours[0, 1].min() > 240
    # nearer than predicted is red, farther is blue
    assert colours[0, 0, 0] > colours[0, 0, 2] + 50
    assert colours[0, 2, 2] > colours[0, 2, 0] + 50
    assert colours[0, 3].tolist() == [105, 105, 105]


def test_panels_are_jpeg_of_one_width(run: Run):
    shelf = build_gallery(run, "paper", per_shelf=1)[0]
    panels = shelf.movers[0].panels
    for uri in (panels.picture, panels.measured, panels.predicted, panels.residual):
        head, data = str(uri).split(",")
        assert head == "data:image/jpeg;base64"
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape[1] == PANEL_WIDTH_PX
        assert picture.std() > 3


def test_a_data_uri_gives_the_picture_back():
    picture = np.full((20, 30, 3), (200, 100, 50), np.uint8)
    data = base64.b64decode(data_uri(picture).split(",")[1])
    back = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.abs(back.astype(int) - picture).max() < 6
