import cv2
import numpy as np
import pytest

from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.detectors.base import Detections
from rescore.metrics.matching import TruthTable, greedy_match, ranking_of
from rescore.results.difficulty import difficulty, difficulty_of_table

KINDS = {1: "ground", 2: "hedge", 3: "poster", 4: "car"}
CAR = [10.0, 10, 50, 30]
HEDGE = [60.0, 10, 100, 30]
POSTER = [110.0, 10, 150, 30]
GROUND = [10.0, 60, 50, 80]


def dataset(root, visibility):
    """Frames of 160 x 100 px with a car, a hedge and a poster; the last frame has no annotated car."""
    instances = np.full((100, 160), 1, np.uint16)
    for number, (x0, y0, x1, y1) in ((4, CAR), (2, HEDGE), (3, POSTER)):
        instances[int(y0) : int(y1), int(x0) : int(x1)] = number
    path = root / "instances.png"
    cv2.imwrite(str(path), instances)
    frames, truth = [], {}
    for i, share in enumerate([*visibility, None]):
        frames.append(FrameRecord(i, path, None, None, "test", 160, 100, None, None, path, KINDS))
        boxes = np.array([CAR] if share is not None else [], float).reshape(-1, 4)
        n = len(boxes)
        truth[i] = Truth(
            np.full(n, 100 + i), boxes, np.zeros(n, bool), np.full(n, share or 0, float), ("",) * n
        )
    return DataSet(root, 1, "car", tuple(frames), truth)


def found(*rows):
    return Detections(
        np.array([r[0] for r in rows], float).reshape(-1, 4), np.array([r[1] for r in rows], float)
    )


def test_figures_by_hand(tmp_path):
    data = dataset(tmp_path, [1.0, 0.9, 0.8])
    detections = {
        0: found((CAR, 9.0), (HEDGE, 8.0)),
        1: found((HEDGE, 7.5), (CAR, 7.0), (GROUND, 6.0)),
        2: found((POSTER, 6.5), (CAR, 5.0)),
        3: found((POSTER, 8.5), (HEDGE, 1.0)),
    }
    result = difficulty(data, detections)
    assert (result.n_images, result.n_cars, result.recall_ceiling) == (4, 3, 1.0)
    # 70 % of 3 cars needs all 3, down to score 5: two hedges, two posters and the ground are false
    assert result.fppi_at_70 == pytest.approx(5 / 4)
    assert dict(result.share_by_kind) == {"hedge": 0.4, "poster": 0.4, "": 0.2}
    assert result.missed == ()


def test_hidden_cars_count_neither_way(tmp_path):
    data = dataset(tmp_path, [1.0, 0.3])
    result = difficulty(data, {0: found((CAR, 5.0)), 1: found((CAR, 9.0))})
    assert (result.n_cars, result.recall_ceiling, result.fppi_at_70) == (1, 1.0, 0.0)
    assert result.share_by_kind == {}
    strict = difficulty(data, {1: found((CAR, 9.0))}, min_visibility=0.2)
    assert (strict.n_cars, strict.recall_ceiling, strict.missed) == (2, 0.5, (100,))


def test_images_without_detections_and_without_cars_count(tmp_path):
    data = dataset(tmp_path, [1.0, 1.0])
    result = difficulty(data, {0: found((CAR, 5.0))})
    assert (result.n_images, result.recall_ceiling, result.fppi_at_70) == (3, 0.5, None)
    assert result.share_by_kind == {}
    assert result.missed == (101,)


def test_a_second_box_on_a_car_is_false(tmp_path):
    data = dataset(tmp_path, [1.0])
    near = [12.0, 10, 52, 30]
    result = difficulty(data, {0: found((near, 6.0), (CAR, 5.0))})
    assert result.fppi_at_70 == 0.0
    twice = dataset(tmp_path, [1.0, 1.0])
    result = difficulty(twice, {0: found((near, 6.0), (CAR, 5.0)), 1: found((CAR, 4.0))})
    assert result.fppi_at_70 == pytest.approx(1 / 3)
    assert dict(result.share_by_kind) == {"car": 1.0}


@pytest.mark.parametrize("visibility", [[1.0, 0.9, 0.8], [1.0, 0.3, 0.9]])
def test_matches_of_all_cars_serve_where_every_car_is_seen(tmp_path, visibility):
    data = dataset(tmp_path, visibility)
    image_id = np.array([0, 0, 1, 1, 2, 3])
    boxes = np.array([CAR, HEDGE, CAR, POSTER, CAR, HEDGE], float)
    score = np.array([9.0, 8.0, 7.0, 6.0, 5.0, 4.0])
    alone = greedy_match(image_id, boxes, ranking_of(score, score), TruthTable.of(data))
    once = difficulty_of_table(data, image_id, boxes, score, alone=alone)
    assert once == difficulty_of_table(data, image_id, boxes, score)
    assert once.n_cars == sum(v >= 0.6 for v in visibility)
