import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.evidence.cues import CUES, cue_column
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.results.explain import ExplainConfig, explain
from rescore.results.words import STATUS_TEXT, favourable, range_text, words_of

HEIGHT, FOOT, SCALE = (cue_column(name) for name in ("height", "foot", "relief_scale"))


def metric_model(floors: dict[str, float] | None = None) -> EvidenceModel:
    """Height speaks from ratio 0.8 to 1.25, feet below 0.5 m, and the scale never much."""
    low, high = np.log(0.8), np.log(1.25)
    knots = {"height": [2 * low, 0.0, 2 * high], "foot": [0.0, 1.0], "relief_scale": [-1.0, 1.0]}
    log_odds = {"height": [-1.0, 1.0, -1.0], "foot": [0.5, -0.5], "relief_scale": [-0.1, -0.1]}
    arrays = [{k: np.array(v) for k, v in part.items()} for part in (knots, log_odds)]
    return EvidenceModel(Registration.METRIC, *arrays, -1.0, 0.5, floors or {})


def rows_of(model: EvidenceModel, cues: np.ndarray, status: list[str] | None = None) -> dict[str, np.ndarray]:
    n = len(cues)
    d = np.where(np.isfinite(model.difference(cues)), model.difference(cues), model.neutral)
    return {
        "image_id": np.arange(n),
        "status": np.full(n, "ok", object),
        "status_metric": np.array(status or ["ok"] * n, object),
        "reason_detail": np.full(n, "of eq. 6", object),
        "difference_metric": d,
        **{f"cue_{name}": cues[:, j] for j, name in enumerate(CUES)},
    }


def cues_with(**values: float) -> np.ndarray:
    cues = np.full(len(CUES), np.nan)
    for name, value in values.items():
        cues[cue_column(name)] = value
    return cues


def test_the_reason_names_what_speaks_most_for_a_riser_and_against_a_faller() -> None:
    model = metric_model()
    tall = cues_with(height=2 * np.log(1.25), foot=0.0, relief_scale=np.log(3.0))
    right = cues_with(height=0.0, foot=0.2, relief_scale=0.0)
    cues = np.stack([tall, right])
    fell, rose = explain(rows_of(model, cues), "metric", np.array([False, True]), model)
    # 1.5 m x 1.25^2 = 2.3 m, against 1.2 to 1.9 m; -1.0 is more than half of what speaks against it
    assert fell.text == "depth speaks against a car (D 0.83): it is 2.3 m tall (cars: 1.2 to 1.9 m)"
    assert [p.cue for p in fell.parts] == ["height", "foot", "relief_scale"]
    assert fell.parts[2].text == "its relief is 3.0 times the predicted one, at its bound"
    assert rose.text.startswith("depth speaks for a car (D 0.4")
    assert rose.text.endswith(": it is 1.5 m tall (cars: 1.2 to 1.9 m)")
    for one, c in zip((fell, rose), cues, strict=True):
        assert sum(p.log_odds for p in one.parts) == pytest.approx(model.contributions(c[None]).sum())


def test_one_that_fell_though_depth_is_for_it_says_so() -> None:
    model = metric_model()
    cues = cues_with(height=0.0, foot=0.0, relief_scale=0.0)[None]
    (one,) = explain(rows_of(model, cues), "metric", np.array([False]), model)
    assert one.text == (
        "depth speaks for a car (D 0.40), but more so for others that passed it; against it: its relief is "
        "1.0 times the predicted one"
    )


def test_one_that_keeps_its_place_is_passed_by_nobody() -> None:
    model = metric_model()
    cues = np.stack(
        [
            cues_with(height=0.0, foot=0.0, relief_scale=0.0),
            cues_with(height=2 * np.log(1.25), foot=0.0, relief_scale=np.log(3.0)),
        ]
    )
    still = np.array([True, True])
    first, second = explain(rows_of(model, cues), "metric", ~still, model, stayed=still)
    assert first.text.startswith("depth speaks for a car (D 0.40): it")
    assert second.text == "depth speaks against a car (D 0.83): it is 2.3 m tall (cars: 1.2 to 1.9 m)"


def test_one_that_rose_though_depth_is_against_it_says_so() -> None:
    model = metric_model()
    tall = cues_with(height=2 * np.log(1.25), foot=0.2, relief_scale=0.0)[None]
    short = cues_with(height=2 * np.log(1.25), foot=0.9, relief_scale=0.0)[None]
    (one,) = explain(rows_of(model, tall), "metric", np.array([True]), model)
    head = "depth speaks against a car (D 0.86), but more so against others that it passed"
    assert one.text == f"{head}; for it: its foot is 0.2 m above the ground (cars: 0.5 m or less)"
    (none,) = explain(rows_of(model, short), "metric", np.array([True]), model)
    assert none.text.endswith("that it passed; nothing speaks for it")


def test_a_height_is_a_multiple_where_the_class_is_not_known() -> None:
    model = metric_model()
    cues = cues_with(height=np.log(2.0), foot=2.0, relief_scale=0.0)[None]
    (one,) = explain(rows_of(model, cues), "metric", np.array([False]), model, ExplainConfig(height_m=None))
    assert "it is 2.0 times as tall as a car (cars: 0.8 to 1.2 times)" in one.text


def test_without_evidence_the_status_and_the_failed_check_are_told() -> None:
    model = metric_model({"agreement": 0.9})
    cues = np.stack([cues_with(height=0, foot=0, agreement=0.75), cues_with(measured=0.125)])
    rows = rows_of(model, cues, ["stereo_not_believed", "no_stereo"])
    doubted, empty = explain(rows, "metric", np.zeros(2, bool), model)
    told = "75.0 % of neighbouring measurements agree, at least 90.0 % needed"
    assert (
        doubted.text
        == f"{STATUS_TEXT['stereo_not_believed']} ({told}): depth counts neither for nor against it"
    )
    assert (
        empty.text
        == "too little measured depth (88 % of stereo missing): depth counts neither for nor against it"
    )
    assert not doubted.parts


def test_a_second_box_names_the_one_that_stays() -> None:
    model = metric_model()
    rows = rows_of(model, np.stack([cues_with(height=0, foot=0, relief_scale=0.0)] * 2), ["second_box"] * 2)
    rows["status"][0] = "second_box"
    rows["reason_detail"][0] = "the same car as candidate 1 at 1, 2, 3, 4"
    named, other = explain(rows, "metric", np.zeros(2, bool), model)
    end = ": ranks below all boxes that stay"
    assert named.text == f"a second box of a car (the same car as candidate 1 at 1, 2, 3, 4){end}"
    # the detail of the table is that of another mode
    assert other.text == f"a second box of a car{end}"


def test_eq_6_is_told_by_its_numbers_and_failures_keep_their_likelihood() -> None:
    rows = {
        "image_id": np.arange(3),
        "status": np.array(["ok", "no_ground_contact", ""], object),
        "reason_detail": np.array(["", "no wheels", None], object),
        "depth_difference": np.array([0.25, np.nan, np.nan]),
        "scale": np.array([-0.5, np.nan, np.nan]),
        "offset": np.array([1.5, np.nan, np.nan]),
        "valid_share": np.array([0.75, np.nan, np.nan]),
    }
    found = explain(rows, "paper", np.array([True, False, True]))
    assert [f.text for f in found] == [
        "D 0.250 (median 0.250), a1 -0.500, a2 +1.50: fits turned inside out, 25 % of stereo missing",
        "no part touches the ground (no wheels): keeps its likelihood; others rose past it",
        "not rescored",
    ]


def test_without_the_model_D_alone_is_told_and_another_model_is_refused() -> None:  # noqa: N802
    model = metric_model()
    cues = cues_with(height=0.0, foot=0.0, relief_scale=0.0)[None]
    rows = rows_of(model, cues)
    (bare,) = explain(rows, "metric", np.array([True]))
    assert bare.text == f"D {rows['difference_metric'][0]:.3f} (median {rows['difference_metric'][0]:.3f})"
    other = EvidenceModel(model.registration, model.knots, model.log_odds, 0.5, 0.5, {})
    with pytest.raises(RescoreError, match="the model that made D of these candidates, got another: 1 of 1"):
        explain(rows, "metric", np.array([True]), other)
    with pytest.raises(RescoreError, match="expected the model of mode guarded, got metric"):
        explain(rows | {"difference_guarded": rows["difference_metric"]}, "guarded", np.array([True]), model)


def test_ranges_where_a_function_is_positive() -> None:
    assert favourable([0, 1, 2, 3], [-1, 1, 1, -3]) == [(0.5, 2.25)]
    assert favourable([0, 1], [1, -1]) == [(-np.inf, 0.5)]
    assert favourable([0, 1, 2], [1, -1, 1]) == [(-np.inf, 0.5), (1.5, np.inf)]
    assert favourable([0.0], [-1.0]) == []
    share = words_of("left")
    assert range_text([(-np.inf, 0.2)], share) == "20 % or less"
    assert range_text([(0.95, np.inf)], share) == "95 % or more"
    # two ranges tell a person nothing
    assert range_text([(-np.inf, 0.2), (0.95, np.inf)], share) == ""
    assert range_text([], share) == range_text([(-np.inf, np.inf)], share) == ""
    assert range_text([(-0.04, 0.5)], words_of("foot")) == "0.0 to 0.5 m"


@pytest.mark.parametrize("cue", CUES)
def test_every_cue_has_words(cue: str) -> None:
    # 0.8: more than a nat where the logarithm is kept
    told = words_of(cue, 1.5).told(0.8)
    assert "{" not in told
    assert any(c.isdigit() for c in told)


def instance_model(**knots: list[float]) -> EvidenceModel:
    """Each named cue speaks for a car between its second and third knot."""
    at = {name: np.array(values) for name, values in knots.items()}
    return EvidenceModel(
        Registration.INSTANCE, at, {name: np.array([-1.0, 1.0, 1.0, -1.0]) for name in at}, 0.0, 0.5, {}
    )


def instance_rows(model: EvidenceModel, cues: np.ndarray, status: list[str]) -> dict[str, np.ndarray]:
    rows = rows_of(model, cues)
    return rows | {
        "difference_instance": rows["difference_metric"],
        "status_instance": np.array(status, object),
    }


def test_where_the_car_ends_is_told_by_its_side_of_the_box() -> None:
    model = instance_model(overlap=[0.4, 0.6, 1.0, 1.2], end_right=[-0.3, -0.1, 0.1, 0.3])
    ends = (0.95, -0.4, 0.01, 1.5)
    cues = np.stack([cues_with(overlap=0.8, end_right=v) for v in ends])
    found = explain(instance_rows(model, cues, ["ok"] * 4), "instance", np.zeros(4, bool), model)
    told = [next(p.text for p in e.parts if p.cue == "end_right") for e in found]
    car, wanted = "the car depth shows", "(cars: 20 % inside to 20 % past)"
    assert told == [
        f"{car} goes 95 % past the box's right edge {wanted}",
        f"{car} ends 40 % inside the box's right edge {wanted}",
        f"{car} ends at the box's right edge {wanted}",
        f"{car} goes at least 150 % past the box's right edge {wanted}",
    ]


def test_what_fell_is_told_by_what_it_is_taken_for() -> None:
    model = instance_model(overlap=[0.4, 0.6, 1.0, 1.2], end_right=[-0.3, -0.1, 0.1, 0.3])
    part = {"overlap": 0.2, "end_right": 0.8, "beyond_box": 0.6, "explained": 2.0}
    cues = np.stack([cues_with(**part), cues_with(**part | {"overlap": 0.8, "end_right": 0.0})])
    rows = instance_rows(model, cues, ["ok"] * 2)
    fell, whole = explain(rows, "instance", np.zeros(2, bool), model)
    assert fell.text.endswith("; taken for a part of a car")
    assert "taken for" not in whole.text
    rose, _ = explain(rows, "instance", np.ones(2, bool), model)
    assert "taken for" not in rose.text


def test_other_explanations_of_the_depth_are_told_in_words() -> None:
    plane, gap, explained = (words_of(cue) for cue in ("over_plane", "gap", "explained"))
    assert plane.told(np.log1p(30)) == "a car explains it better than a flat board, by 30 nats"
    assert plane.told(-np.log1p(30)) == "a flat board explains the depth better, by 30 nats"
    assert plane.told(-0.3) == "a flat board explains the depth as well as a car"
    assert gap.told(0.44) == "a car elsewhere explains the depth 44 % better"
    assert gap.told(0.0) == "no car elsewhere explains the depth better"
    assert explained.told(-1.8) == "an empty place explains the depth 180 % better"
    assert range_text([(np.log1p(2), np.inf)], plane) == "2 for a car or more"
    assert range_text([(-np.inf, -np.log1p(2))], plane) == "at least 2 for a board"
    assert range_text([(-np.log1p(2), np.inf)], plane) == "at most 2 for a board"
    assert range_text([(np.log1p(2), np.log1p(9))], plane) == "2 to 9 for a car"
    assert range_text([(-np.log1p(9), -np.log1p(2))], plane) == "2 to 9 for a board"
    assert range_text([(-np.inf, 0.19)], gap) == "19 % better elsewhere or less"
    assert range_text([(0.1, 0.19)], gap) == "10 to 19 % better elsewhere"


def test_a_box_in_which_no_car_could_be_placed_says_so_where_stereo_measured() -> None:
    model = instance_model(overlap=[0.4, 0.6, 1.0, 1.2])
    cues = np.stack([cues_with(measured=1.0), cues_with(measured=0.0)])
    rows = instance_rows(model, cues, ["no_stereo"] * 2)
    placed, empty = explain(rows, "instance", np.ones(2, bool), model)
    assert placed.text == (
        "no car could be placed (a car's distance is not known): depth counts neither for nor against it"
    )
    assert (
        empty.text
        == "too little measured depth (100 % of stereo missing): depth counts neither for nor against it"
    )
