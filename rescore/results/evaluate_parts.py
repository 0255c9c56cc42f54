"""Evaluation of tables in parts: as ``rescore.results.evaluate``, with memory for a few numbers a candidate.

Candidates are matched with the cars of their images some parts at a time, and go out again, with what became
of them, as the parts of ``candidates``: the next are read and the last written meanwhile. Of each, image,
scores and outcomes stay, some fifty bytes, and its pairs with cars that its 3D box overlaps by half. From
these come the curves, by the functions that all curves come from, and the intervals, by sums over images.

Figures are those of the evaluation in memory, to the last digit; intervals agree within what resamples vary
by.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray, constant
from recon.errors import RescoreError
from rescore.data.boxes3d import BOX_NAMES, Boxes3D
from rescore.data.frames import DataSet, FrameRecord
from rescore.data.rendered_kinds import UNKNOWN, kinds_of_table
from rescore.evidence.registration import Registration
from rescore.formats.coco import OTHER_SPLIT
from rescore.formats.parts.candidates import mode_of, refuse_kind
from rescore.formats.parts.forms import CANDIDATE_SCHEMA, CORNERS, DETECTIONS, RESCORED
from rescore.formats.parts.frames import data_of, data_parts, has_instances, truth_of_parts
from rescore.formats.parts.table import Part, PartTable, refuse_as_table, write_part
from rescore.fusion.fuse import RULES, LearnedFusion, posterior_of
from rescore.fusion.tune import Tuning
from rescore.memory import give_back
from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.curves import fppi_at_recall, recall_ceiling, recall_curve, summarise, ties
from rescore.metrics.image_sums import bootstrap_by_sums
from rescore.metrics.matching import (
    AT_A_TIME,
    HIT,
    IGNORED,
    MIN_IOU,
    MatchTable,
    Overlaps,
    TruthTable,
    falling_ranks,
    ranked_order,
    ranking_of,
)
from rescore.metrics.reliability import reliability
from rescore.results.candidate_file import ALONE, Given, arrow_rows, detector_columns, parts_schema
from rescore.results.comparisons import certainty
from rescore.results.difficulty import CAR_LEVEL, MIN_VISIBILITY, share_by_kind
from rescore.results.evaluate import RELIABILITY_BINS, tuning_rows
from rescore.results.evaluate3d import Decided, Detections3D, Found3D, TrueCars
from rescore.results.metrics_file import (
    BootstrapSettings,
    Boxes3DRow,
    DetectorDifficulty,
    FusionRow,
    Metrics,
    ModeComparison,
    ReliabilityRow,
    Row,
    StereoStatistics,
    finite,
    write_metrics,
)
from rescore.results.run_folder import RunFolder

CANDIDATES = "candidates"
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class EvaluatedFrames:
    """What is known of the frames of an evaluation: their cars, and the records of those that tell kinds."""

    where: Path
    truth: TruthTable
    visibility: FloatArray
    """Visible share of each car, NaN where unknown, shape (m,)."""
    rendered: Mapping[int, FrameRecord]
    """Records of the frames that have a picture of instance numbers, by image id."""
    cars3d: TrueCars | None
    """The cars with what is known of them in 3D; None where nothing is."""

    @classmethod
    def of_data(cls, data: DataSet) -> Self:
        """What is known of a data set in memory."""
        seen = [data.truth[f.image_id].visibility for f in data.frames]
        rendered = {f.image_id: f for f in data.frames if f.instance_path is not None}
        visibility = np.concatenate([np.zeros(0), *seen])
        return cls(data.root, TruthTable.of(data), visibility, rendered, TrueCars.of(data))

    @classmethod
    def of_parts(cls, table: PartTable, split: str) -> Self:
        """What is known of a split of a data set in parts ("all" for every frame)."""
        if has_instances(table):
            parts = list(data_parts(table))
            frames = [f for p in parts for f in p.frames if split in {f.split, "all"}]
            truth = {i: t for p in parts for i, t in p.truth.items()}
            return cls.of_data(data_of(table, frames, truth))
        cars, known = truth_of_parts(table, split)
        cars3d = TrueCars.of_columns(
            cars,
            known.boxes3d,
            azimuth_deg=known.azimuth_deg,
            truncated=known.truncated,
            occluded=known.occluded,
            visibility=known.visibility,
        )
        return cls(table.root, cars, known.visibility, {}, cars3d)

    @property
    def judged(self) -> bool:
        """Whether any car is annotated that can be found."""
        return self.truth.n_cars > 0

    @cached_property
    def matched_with(self) -> TruthTable:
        """The cars; where none is annotated a region over every picture: nothing is then right or wrong."""
        if self.judged:
            return self.truth
        n = self.truth.n_images
        everywhere = np.broadcast_to(np.array([-1e9, -1e9, 1e9, 1e9]), (n, 4))
        return TruthTable(
            self.truth.image_id, np.arange(n), np.full(n, -1), everywhere.copy(), np.ones(n, np.bool_)
        )

    @cached_property
    def hidden(self) -> BoolArray:
        """Cars that are seen less than ``MIN_VISIBILITY``, shape (m,)."""
        return ~self.truth.ignore & (self.visibility < MIN_VISIBILITY)

    @cached_property
    def _order(self) -> IntArray:
        return np.argsort(self.truth.image_id, kind="stable")

    def places(self, image_id: IntArray) -> IntArray:
        """Place of each image (n,) among all.

        Raises:
            RescoreError: one is not among them.
        """
        at = np.searchsorted(self.truth.image_id, image_id, sorter=self._order)
        place = self._order[np.minimum(at, self.truth.n_images - 1)]
        strange = self.truth.image_id[place] != image_id
        if strange.any():
            raise RescoreError(
                f"{self.where}: expected images of the data set and split, got image_id "
                f"{image_id[strange][0]}; {OTHER_SPLIT}, or use detections of this data set"
            )
        return place


def evaluate_parts(
    frames: EvaluatedFrames,
    tables: Sequence[PartTable],
    run_dir: Path,
    *,
    tunings: Mapping[tuple[str, Registration], Tuning] | None = None,
    min_iou: float = MIN_IOU,
    seed: int = 0,
) -> Metrics:
    """Write the parts of ``candidates`` and ``metrics.json`` of detections in parts; returns the metrics.

    Arguments and rows are those of ``rescore.results.evaluate.evaluate``.

    Raises:
        RescoreError: as there, or an image in two parts.
    """
    if not frames.truth.n_images:
        raise RescoreError(
            f"{frames.where}: expected frames to evaluate, got none of the split; choose another"
        )
    tunings = tunings or {}
    refuse_as_table(run_dir / CANDIDATES, CANDIDATES, [t.root for t in tables])
    groups = _by_detector(tables)
    schema = parts_schema(dict.fromkeys(str(mode_of(t)) for t in tables if t.kind == RESCORED))
    drawn = BootstrapConfig.for_candidates(max(t.rows for t in tables))
    written: list[Part] = []
    found = _Found()
    for own in groups:
        usual = min_iou == MIN_IOU and frames.judged and not frames.hidden.any()
        one = _Detector.empty(own, frames, tunings, hard=not usual)
        written += _written(run_dir / CANDIDATES, one.matched(min_iou), schema, len(written))
        # what was read goes back before, and 3D boxes after their figures: the others take most memory
        give_back()
        found.boxes3d.extend(one.boxes3d_rows())
        give_back()
        found.add(one, seed, drawn)
    metrics = Metrics(
        n_images=frames.truth.n_images,
        n_cars=frames.truth.n_cars,
        n_ignored=int(frames.truth.ignore.sum()),
        n_candidates=sum(own[0].rows for own in groups),
        rows=tuple(found.rows),
        comparisons=tuple(found.comparisons),
        fusion=tuple(found.fusion),
        reliability=tuple(found.reliability),
        bootstrap=BootstrapSettings(n_resamples=drawn.n_resamples, confidence=drawn.confidence, seed=seed),
        stereo=StereoStatistics(),
        reasons=found.reasons,
        tuning=tuning_rows(tunings),
        difficulty=found.difficulty,
        boxes3d=tuple(found.boxes3d),
    )
    PartTable(run_dir / CANDIDATES, CANDIDATES, {}, tuple(written)).write()
    write_metrics(RunFolder(run_dir).metrics, metrics)
    return metrics


def _written(root: Path, groups: Iterable[dict[str, Any]], schema: pa.Schema, n_before: int) -> list[Part]:
    """The parts of rows, each written while the next are matched."""
    written: list[Future[Part]] = []
    with ThreadPoolExecutor(max_workers=1) as writer:
        for number, rows in enumerate(groups, start=n_before):
            written.append(writer.submit(_write, root, f"{number:06d}", rows, schema))
            # no more than two are held
            for earlier in written[-2:-1]:
                earlier.result()
    return [part.result() for part in written]


def _write(root: Path, name: str, rows: dict[str, Any], schema: pa.Schema) -> Part:
    n_bytes = write_part(root, name, [arrow_rows(rows, schema)])
    return Part(name=name, rows=len(rows["image_id"]), bytes=n_bytes)


def _by_detector(tables: Sequence[PartTable]) -> list[list[PartTable]]:
    """The tables of each detector, that of eq. 6 first.

    Raises:
        RescoreError: none, two of one mode, or tables of one detector with other frames in their parts.
    """
    if not tables:
        raise RescoreError("evaluate: expected at least one table of detections, got none; name one")
    groups: dict[str, list[PartTable]] = {}
    for table in tables:
        refuse_kind(table, (DETECTIONS, RESCORED))
        groups.setdefault(str(table.said("detector")), []).append(table)
    for name, own in groups.items():
        own.sort(key=lambda t: (t.kind != RESCORED, list(Registration).index(mode_of(t))))
        kinds = Counter(str(mode_of(t)) if t.kind == RESCORED else "raw" for t in own)
        twice = [kind for kind, count in kinds.items() if count > 1]
        if twice:
            raise RescoreError(
                f"evaluate: expected one table a detector and mode, got two of {name!r} ({twice[0]}); "
                "rename one"
            )
        for other in own[1:]:
            if [(p.rows, p.frames) for p in other.parts] != [(p.rows, p.frames) for p in own[0].parts]:
                raise _other_candidates(name, other.root)
    return list(groups.values())


def _other_candidates(detector: str, where: Path) -> RescoreError:
    return RescoreError(
        f"evaluate: expected the same candidates in the same parts of all tables of {detector!r}, got others "
        f"in {where}; apply all modes to one file of detections"
    )


@dataclass(frozen=True, eq=False)
class _Detector:
    """The candidates of one detector, n in all, of which a few numbers each are kept."""

    own: Sequence[PartTable]
    frames: EvaluatedFrames
    tunings: Mapping[tuple[str, Registration], Tuning]
    columns: dict[str, NDArray[Any]]
    """Arrays (n,): image, score, likelihood, kind; posterior, D and outcomes of each mode and rule."""
    kinds: list[str]
    """Kind of each code in the column of kinds."""
    reasons: Counter[str]
    solid: PartTable | None
    """The table whose 3D boxes are judged; None where there are none, or no car has one."""
    found3d: Found3D | None

    @classmethod
    def empty(
        cls,
        own: Sequence[PartTable],
        frames: EvaluatedFrames,
        tunings: Mapping[tuple[str, Registration], Tuning],
        *,
        hard: bool,
    ) -> Self:
        """The columns, all zero; ``hard``: those of well-seen cars need outcomes of their own."""
        n = own[0].rows
        columns: dict[str, NDArray[Any]] = {
            "image": np.zeros(n, np.int32),
            "score": np.zeros(n),
            "likelihood": np.zeros(n),
            "kind": np.zeros(n, np.int8),
            f"outcome {ALONE}": np.zeros(n, np.int8),
        }
        if hard:
            columns["outcome hard"] = np.zeros(n, np.int8)
        solid = None if frames.cars3d is None else next(filter(_has_boxes3d, own), None)
        modes = [ALONE, *(str(mode_of(t)) for t in own if t.kind == RESCORED)]
        found3d = None if frames.cars3d is None or solid is None else Found3D(frames.cars3d, modes)
        made = cls(own, frames, tunings, columns, [UNKNOWN], Counter(), solid, found3d)
        for mode in made.modes:
            columns |= {f"posterior {mode}": np.zeros(n), f"difference {mode}": np.zeros(n)}
            columns[f"outcome {mode}"] = np.zeros(n, np.int8)
            columns |= {f"outcome {mode} {rule}": np.zeros(n, np.int8) for rule in made.rules(mode)}
        return made

    @property
    def name(self) -> str:
        return str(self.own[0].said("detector"))

    @property
    def modes(self) -> list[Registration]:
        """Modes in which it was rescored."""
        return [mode_of(t) for t in self.own if t.kind == RESCORED]

    def w(self, mode: Registration) -> float | None:
        w = next(t.about.get("w") for t in self.own if mode_of(t) is mode and t.kind == RESCORED)
        return None if w is None else float(w)

    def learned(self, mode: Registration) -> LearnedFusion | None:
        tuning = self.tunings.get((self.name, mode))
        return None if tuning is None else tuning.learned

    def rules(self, mode: Registration) -> list[str]:
        """Ways of fusing whose numbers are known."""
        one = np.zeros(1)
        return [r for r in RULES if posterior_of(r, one, one, self.w(mode), self.learned(mode)) is not None]

    def matched(self, min_iou: float) -> Iterator[dict[str, Any]]:
        """Fill the columns, some parts at a time; the rows of candidates.parquet of these."""
        begin, seen = 0, np.zeros(self.frames.truth.n_images, np.bool_)
        for tables, n in _one_ahead(_read_together(self.own)):
            place = self.frames.places(tables[0]["image_id"].to_numpy())
            self._refuse_seen(place, n, seen)
            rows = slice(begin, begin + len(place))
            yield self._match(tables, place, rows, min_iou)
            begin = rows.stop

    def _refuse_seen(self, place: IntArray, rows_of_part: Sequence[int], seen: BoolArray) -> None:
        begin = 0
        for n in rows_of_part:
            images = place[begin : begin + n]
            if seen[images].any():
                twice = self.frames.truth.image_id[images[seen[images]][0]]
                raise RescoreError(
                    f"{self.own[0].root}: expected the candidates of an image in one part, got image {twice} "
                    "in two; write the detections again"
                )
            seen[images] = True
            begin += n

    def _match(
        self, tables: Sequence[pa.Table], place: IntArray, rows: slice, min_iou: float
    ) -> dict[str, Any]:
        first, columns = tables[0], self.columns
        images, image = np.unique(place, return_inverse=True)
        truth = self.frames.matched_with.take(images)
        xyxy_px, score = _boxes(first), _numbers(first, "detector_score")
        overlaps = Overlaps.of(truth.image_id[image], xyxy_px, truth, min_iou)
        kind = self._kinds(truth.image_id, image, xyxy_px, rows)
        columns["image"][rows], columns["score"][rows] = place, score
        columns["likelihood"][rows] = _numbers(first, "likelihood")
        self.reasons.update({c["values"]: c["counts"] for c in pc.value_counts(first["status"]).to_pylist()})
        if "outcome hard" in columns:
            hard = replace(self.frames.truth, ignore=self.frames.truth.ignore | self.frames.hidden)
            seen = Overlaps.of(truth.image_id[image], xyxy_px, hard.take(images), MIN_IOU)
            columns["outcome hard"][rows] = seen.decided(score)[0]
        decided = {ALONE: Decided((score,), *overlaps.decided(score))}
        for mode, table in zip(self.modes, tables, strict=False):
            decided[str(mode)] = self._match_mode(mode, table, overlaps, rows)
        for name, one in decided.items():
            columns[f"outcome {name}"][rows] = one.outcome
        if self.found3d is not None and self.solid is not None:
            solid = _boxes3d(tables[list(self.own).index(self.solid)])
            azimuth_deg = _numbers(tables[list(self.own).index(self.solid)], "azimuth_deg")
            self.found3d.add(images, Detections3D(image, xyxy_px, solid, azimuth_deg), decided)
        given = [
            Given(self.name, mode_of(t) if t.kind == RESCORED else None, t.about.get("w"), _named(rows_of))
            for t, rows_of in zip(self.own, tables, strict=True)
        ]
        matched = {mode: decided[str(mode)] for mode in self.modes}
        return detector_columns(given, decided[ALONE], matched, kind)

    def _match_mode(self, mode: Registration, table: pa.Table, overlaps: Overlaps, rows: slice) -> Decided:
        columns, score = self.columns, self.columns["score"][rows]
        posterior = _numbers(table, "posterior")
        columns[f"posterior {mode}"][rows] = posterior
        columns[f"difference {mode}"][rows] = _numbers(table, "depth_difference")
        for rule in self.rules(mode):
            ranked = overlaps.decided(self._rule_score(rule, mode, rows), score)
            columns[f"outcome {mode} {rule}"][rows] = ranked[0]
        return Decided((posterior, score), *overlaps.decided(posterior, score))

    def _kinds(
        self, image_id: IntArray, image: IntArray, xyxy_px: FloatArray, rows: slice
    ) -> NDArray[np.object_]:
        """What fills most of each box; the columns have its code."""
        records = [self.frames.rendered[i] for i in image_id.tolist() if i in self.frames.rendered]
        if not records:
            return constant(UNKNOWN, (len(image),), object)
        kind = kinds_of_table(records, image_id[image], xyxy_px)
        self.columns["kind"][rows] = self._codes(kind)
        return kind

    def boxes3d_rows(self) -> list[Boxes3DRow]:
        """The figures of 3D boxes by mode; none where there are no boxes."""
        if self.found3d is None:
            return []
        score = self.columns["score"]
        ranked = {ALONE: score, **{str(m): self.columns[f"posterior {m}"] for m in self.modes}}
        rankings = ((mode, ranking_of(first, score)) for mode, first in ranked.items())
        return self.found3d.rows(self.name, rankings)

    def _rule_score(self, rule: str, mode: Registration, rows: slice) -> FloatArray:
        lik, d = self.columns["likelihood"][rows], self.columns[f"difference {mode}"][rows]
        score = posterior_of(rule, lik, d, self.w(mode), self.learned(mode))
        assert score is not None, "the numbers of a rule in use are known"
        return score

    def _codes(self, kind: NDArray[np.object_]) -> NDArray[np.int8]:
        for name in set(kind.tolist()) - set(self.kinds):
            self.kinds.append(name)
        code = {name: i for i, name in enumerate(self.kinds)}
        return np.array([code[k] for k in kind.tolist()], np.int8)

    def table(self, mode: str) -> MatchTable:
        """The match table of the detector alone, "hard" for its well-seen cars alone, or of a mode."""
        score = self.columns["score"]
        first = score if mode in {ALONE, "hard"} else self.columns[f"posterior {mode}"]
        return self._of(first, self.columns[f"outcome {mode}"])

    def rule_table(self, mode: Registration, rule: str) -> MatchTable:
        """The match table of a way of fusing."""
        score = self._rule_score(rule, mode, slice(None))
        return self._of(score, self.columns[f"outcome {mode} {rule}"])

    def _of(self, score: FloatArray, outcome: NDArray[np.int8]) -> MatchTable:
        image: Any = self.columns["image"]
        n_images, n_cars = self.frames.truth.n_images, self.frames.matched_with.n_cars
        unknown = constant(-1, (len(image),), np.int64)
        if self.kinds != [UNKNOWN]:
            ranking = ranking_of(score, self.columns["score"])
            return MatchTable(n_images, n_cars, image, ranking, outcome, unknown)
        # what is in order once is sorted again in no time; kinds would have to follow
        order, fresh = ranked_order(score, self.columns["score"])
        return MatchTable(n_images, n_cars, image[order], falling_ranks(fresh), outcome[order], unknown)

    @property
    def kind(self) -> NDArray[np.object_]:
        """What fills most of the box of each candidate, shape (n,)."""
        if self.kinds == [UNKNOWN]:
            return constant(UNKNOWN, (len(self.columns["kind"]),), object)
        return np.asarray(np.array(self.kinds, dtype=object)[self.columns["kind"]])


def _read_together(own: Sequence[PartTable]) -> Iterator[tuple[list[pa.Table], list[int]]]:
    """The candidates of so many parts as are matched at once, in each mode, and the rows of each part."""
    waiting: list[int] = []
    for i, part in enumerate(own[0].parts):
        waiting.append(i)
        if sum(own[0].parts[k].rows for k in waiting) >= AT_A_TIME or part is own[0].parts[-1]:
            tables = [_rows(t, [t.parts[k] for k in waiting], t is own[0]) for t in own]
            for table, rows in zip(own[1:], tables[1:], strict=True):
                if any(not rows[name].equals(tables[0][name]) for name in ("image_id", *CORNERS)):
                    raise _other_candidates(str(table.said("detector")), table.root)
            yield tables, [own[0].parts[k].rows for k in waiting]
            waiting = []


def _rows(table: PartTable, parts: Sequence[Part], first: bool) -> pa.Table:
    """The candidates of some parts: all columns of the first mode, of others what may differ."""
    names = CANDIDATE_SCHEMA.names if first else _OF_A_MODE
    rows = pa.concat_tables([table.columns(part, names) for part in parts])
    texts = [f.name for f in rows.schema if pa.types.is_string(f.type) and rows[f.name].null_count]
    for name in texts:
        rows = rows.set_column(rows.schema.get_field_index(name), name, rows[name].fill_null(""))
    return rows


_OF_A_MODE = [
    *("image_id", *CORNERS, "posterior", "depth_difference", "status", "azimuth_deg"),
    *(name for name in CANDIDATE_SCHEMA.names if name.startswith("box3d_")),
    *("view_bin", "view_probability", "second_view"),
]


def _one_ahead(items: Iterator[T]) -> Iterator[T]:
    """Items as they come, the next of which is made while one is used."""
    with ThreadPoolExecutor(max_workers=1) as maker:
        waiting = maker.submit(next, items, None)
        while (item := waiting.result()) is not None:
            waiting = maker.submit(next, items, None)
            yield item


def _numbers(rows: pa.Table, name: str) -> FloatArray:
    """A column as numbers (n,), NaN where empty."""
    return np.asarray(rows[name].to_numpy(), float)


def _boxes(rows: pa.Table) -> FloatArray:
    return np.stack([_numbers(rows, name) for name in CORNERS], axis=1)


def _boxes3d(rows: pa.Table) -> Boxes3D:
    return Boxes3D.of_values(np.stack([_numbers(rows, f"box3d_{name}") for name in BOX_NAMES], axis=1))


def _named(rows: pa.Table) -> dict[str, Any]:
    return dict(zip(rows.column_names, rows.columns, strict=True))


def _has_boxes3d(table: PartTable) -> bool:
    """Whether a candidate of a table has a 3D box."""
    name = f"box3d_{BOX_NAMES[0]}"
    return any(table.columns(part, [name])[name].null_count < part.rows for part in table.parts)


@dataclass(frozen=True, eq=False)
class _Found:
    """The figures of all detectors."""

    rows: list[Row] = field(default_factory=list)
    comparisons: list[ModeComparison] = field(default_factory=list)
    fusion: list[FusionRow] = field(default_factory=list)
    reliability: list[ReliabilityRow] = field(default_factory=list)
    reasons: dict[str, dict[str, int]] = field(default_factory=dict)
    difficulty: dict[str, DetectorDifficulty] = field(default_factory=dict)
    boxes3d: list[Boxes3DRow] = field(default_factory=list)

    def add(self, one: _Detector, seed: int, drawn: BootstrapConfig) -> None:
        """Add the figures of a detector whose candidates are matched."""
        tables = {mode: one.table(mode) for mode in (ALONE, *map(str, one.modes))}
        cars = one.frames.matched_with.cars_of_image
        sure = certainty(one.name, tables, one.kind, cars, seed, drawn, by=bootstrap_by_sums)
        summaries = {mode: summarise(match) for mode, match in tables.items()}
        for mode, match in tables.items():
            w = 1.0 if mode == ALONE else one.w(Registration(mode))
            interval = sure.intervals[mode]
            self.rows.append(Row.of(one.name, mode, w, summaries[mode], interval, ties(match)))
        self.comparisons.extend(sure.comparisons)
        self.difficulty[one.name] = _difficulty(one, tables[ALONE])
        tables.clear()
        for mode in one.modes:
            self.fusion.append(FusionRow.of(one.name, mode.value, ALONE, summaries[ALONE]))
            for rule in one.rules(mode):
                summary = summarise(one.rule_table(mode, rule))
                self.fusion.append(FusionRow.of(one.name, mode.value, rule, summary))
        self._reliability(one)
        self.reasons[one.name] = dict(sorted(one.reasons.items()))

    def _reliability(self, one: _Detector) -> None:
        scores = {ALONE: one.columns["likelihood"]}
        scores |= {mode.value: one.columns[f"posterior {mode}"] for mode in one.modes}
        for mode, score in scores.items():
            outcome = one.columns[f"outcome {mode}"]
            use = outcome != IGNORED
            if use.any() and not np.isnan(score[use]).any():
                r = reliability(score[use], outcome[use] == HIT, RELIABILITY_BINS)
                self.reliability.append(ReliabilityRow.of(one.name, mode, r))


def _difficulty(one: _Detector, alone: MatchTable) -> DetectorDifficulty:
    """What the detector alone makes of the cars that are seen well, by ``rescore.results.difficulty``."""
    hard = one.columns.get("outcome hard")
    truth = one.frames.truth
    seen = int((~truth.ignore & ~one.frames.hidden).sum())
    match = alone if hard is None else replace(one.table("hard"), n_cars=seen)
    curve = recall_curve(match)
    return DetectorDifficulty(
        n_cars=match.n_cars,
        recall_ceiling=finite(recall_ceiling(curve)),
        fppi_at_70=fppi_at_recall(curve, CAR_LEVEL),
        share_by_kind=share_by_kind(match, curve, one.kind),
    )
