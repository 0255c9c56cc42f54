"""What depth is worth on labelled frames of one's own, fitted with them: one place is left out at a time.

Neighbouring frames show the same cars, so frames are left out by place (``rescore.studies.places``). The cues
of all candidates come from the class model of a rescorer. D of each place is fitted to the candidates of all
others, and w stays that of the rescorer. The candidates of all places together give the figures.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from recon.arrays import BoolArray
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.data.splits import FittingSet, Splits
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.candidates import OK, Candidates, CandidateTable
from rescore.evidence.fit_model import EvidenceConfig, fit_evidence, labelled_cues
from rescore.evidence.registration import Registration
from rescore.evidence.settings import with_stereo_for
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.rescore_frames import rescore_frames
from rescore.fusion.tune import match_at
from rescore.library.rescorer import Rescorer
from rescore.metrics.bootstrap import Bootstrap, BootstrapConfig, bootstrap
from rescore.metrics.matching import TruthTable
from rescore.metrics.resampled import Levels
from rescore.parallel import one_thread, track
from rescore.results.candidate_file import ALONE
from rescore.results.sweep_file import StudyPart, SweptInterval, swept_levels
from rescore.studies.class_model_worth import Change
from rescore.studies.places import places_of

MODE = Registration.INSTANCE
AS_IT_IS, FITTED = "rescorer", "fitted"
"""The rescorer as it is, and with D fitted on the other places."""
PAIRS = ((ALONE, FITTED), (AS_IT_IS, FITTED), (ALONE, AS_IT_IS))
"""Ways of scoring that are compared, before and after."""
RECALLS = (0.5, 0.6, 0.7, 0.8, 0.9)
"""Shares of all cars at which false positives are compared."""


class PlaceFacts(StudyPart):
    """One place."""

    image_ids: tuple[int, ...]
    """Frames of the place."""
    n_cars: int
    """Annotated cars in them that count."""
    n_candidates: int
    n_others: int
    """Candidates of the other places that D was fitted to."""
    n_cars_of_others: int
    """Cars among these candidates."""


class WayFigures(StudyPart):
    """One way of scoring the candidates."""

    with_evidence: float
    """Share of the candidates with depth evidence."""
    area: SweptInterval
    """Area under the candidate ROC."""
    average_precision: SweptInterval
    fppi: dict[str, SweptInterval]
    """False positives an image by recall, as "0.7"."""


class Comparison(StudyPart):
    """Two ways of scoring, paired over images."""

    before: str
    after: str
    change: Change


class PlacesResult(StudyPart):
    """The content of the study's file."""

    command: str
    """What made it."""
    detector: str
    w: float
    """Weight of eq. 7, that of the rescorer."""
    n_images: int
    n_cars: int
    n_candidates: int
    places: tuple[PlaceFacts, ...]
    """In the order of the data set."""
    figures: dict[str, WayFigures]
    """By ``ALONE``, ``AS_IT_IS`` and ``FITTED``."""
    comparisons: tuple[Comparison, ...]
    """The pairs of ``PAIRS``, in their order."""

    @property
    def largest(self) -> PlaceFacts:
        """The place with the most frames."""
        return max(self.places, key=lambda place: len(place.image_ids))


@dataclass(frozen=True, eq=False)
class LabelledPlaces:
    """Labelled frames by place, and the candidates of a detector in them with all their cues."""

    data: DataSet
    places: tuple[tuple[int, ...], ...]
    """Image ids of each place; every frame is of one."""
    table: CandidateTable

    def of_place(self, number: int) -> BoolArray:
        """The candidates of a place, shape (n,)."""
        return np.isin(self.table.image_id, self.places[number])

    def others(self, number: int) -> FittingSet:
        """The frames of all places but one.

        Raises:
            RescoreError: a picture or a rendered car of the place is one of another place too.
        """
        own = set(self.places[number])
        frames = tuple(replace(f, split="test" if f.image_id in own else "train") for f in self.data.frames)
        return Splits.of(replace(self.data, frames=frames)).fitting_set


def study_places(
    data: DataSet,
    detector: str,
    candidates: Mapping[int, Candidates],
    rescorer: Rescorer,
    command: str,
    *,
    seed: int,
    jobs: Workers,
) -> PlacesResult:
    """The figures of a detector on labelled frames: alone, rescored, and with D fitted on other places.

    Args:
        data: labelled frames; those of a street follow each other.
        detector: name of what found the candidates.
        candidates: of each frame by image id, with likelihoods.
        rescorer: class model, w, settings and a D to compare with, mode instance.
        command: what made it, for the file.
        seed: of the bootstrap.
        jobs: frames at a time; the result is the same for any number.

    Raises:
        RescoreError: a rescorer of another mode, or a place without which too few cars are left to fit D.
    """
    model, as_it_is = rescorer.class_model, rescorer.evidence_model
    if model is None or as_it_is is None or rescorer.mode is not MODE:
        raise RescoreError(
            f"places: expected a rescorer of mode {MODE} with a class model, got mode {rescorer.mode}; give "
            "another"
        )
    config = with_stereo_for(rescorer.config, data, None)
    places = places_of(data, jobs)
    evidence = Rescoring(config, predict=MODE.predicts)
    found = rescore_frames(data, candidates, model, evidence, jobs=jobs, progress="depth evidence")
    given = LabelledPlaces(data, places, found.candidates)
    tables = {ALONE: given.table, AS_IT_IS: Rescoring(config, as_it_is).fuse(given.table).candidates}
    tables[FITTED], facts = leave_one_out(given, EvidenceConfig(), jobs)
    return _result(tables, facts, TruthTable.of(data), rescorer.w, detector, command, seed)


def leave_one_out(
    given: LabelledPlaces, config: EvidenceConfig, jobs: Workers
) -> tuple[CandidateTable, tuple[PlaceFacts, ...]]:
    """The candidates with D of a model that was fitted on all other places, and the facts of each place.

    Candidates come by place.

    Raises:
        RescoreError: a place without which too few cars are left to fit D.
    """
    count = len(given.places)
    done = list(track(map_frames(_left_out, range(count), (given, config), jobs), "places left out", count))
    return CandidateTable.concatenate([table for table, _ in done]), tuple(facts for _, facts in done)


def _left_out(
    number: int, shared: tuple[LabelledPlaces, EvidenceConfig]
) -> tuple[CandidateTable, PlaceFacts]:
    given, config = shared
    own, others = given.of_place(number), given.others(number)
    cues, is_car = labelled_cues(given.table.take(~own), others)
    frames = given.places[number]
    try:
        with one_thread():
            model = fit_evidence(cues, is_car, MODE, config)
    except RescoreError as error:
        raise RescoreError(
            f"place {number + 1} of {len(given.places)} ({len(frames)} of {len(given.data.frames)} frames), "
            f"left out: {error}"
        ) from error
    judged = Rescoring(evidence_model=model).fuse(given.table.take(own)).candidates
    truth = [given.data.truth[image_id] for image_id in frames]
    return judged, PlaceFacts(
        image_ids=frames,
        n_cars=sum(int((~t.ignore).sum()) for t in truth),
        n_candidates=len(judged),
        n_others=len(is_car),
        n_cars_of_others=int(is_car.sum()),
    )


def _result(
    tables: Mapping[str, CandidateTable],
    facts: Sequence[PlaceFacts],
    truth: TruthTable,
    w: float,
    detector: str,
    command: str,
    seed: int,
) -> PlacesResult:
    """The figures of each way of scoring; ``tables`` have its D."""
    matches = {
        name: match_at(table, truth, 1.0 if name == ALONE else w, 0.5) for name, table in tables.items()
    }
    rng = np.random.default_rng(seed)
    config = BootstrapConfig(levels=Levels(recalls=RECALLS))
    found = bootstrap(matches, truth.cars_of_image, PAIRS, rng, config)
    return PlacesResult(
        command=command,
        detector=detector,
        w=w,
        n_images=truth.n_images,
        n_cars=truth.n_cars,
        n_candidates=len(tables[ALONE]),
        places=tuple(facts),
        figures={name: _figures(found, name, table) for name, table in tables.items()},
        comparisons=tuple(
            Comparison(before=before, after=after, change=Change.of(found.comparisons[before, after]))
            for before, after in PAIRS
        ),
    )


def _figures(found: Bootstrap, name: str, table: CandidateTable) -> WayFigures:
    figures = found.tables[name]
    return WayFigures(
        with_evidence=0.0 if name == ALONE else float((table.status == OK).mean()),
        area=SweptInterval.of(figures.auc),
        average_precision=SweptInterval.of(figures.average_precision),
        fppi=swept_levels(figures.fppi_at_recall),
    )


def write_places(path: Path, result: PlacesResult) -> None:
    """Write the study's file."""
    write_json(path, result.as_json())


def read_places(path: Path) -> PlacesResult:
    """The study in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(PlacesResult), "a study of frames left out by place")
