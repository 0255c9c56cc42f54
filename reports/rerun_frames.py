"""The frames of a recording, prepared by several processes and handed over in order."""

import pickle
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from joblib import Parallel, delayed
from numpy import int64
from numpy.typing import NDArray

from recon.class_model import ClassModel
from reports.evidence_view import CandidateView, FrameReader, FrameView
from reports.rerun_boxes import log_boxes
from reports.rerun_candidate import log_candidate, log_models
from reports.rerun_frame import log_frame
from reports.rerun_names import CANDIDATE_TIME
from reports.rerun_story import Story
from reports.rerun_tape import Tape
from reports.rerun_threshold import MAX_TILES, Tile
from rescore.threads import one_thread

MAX_EXPLAINED = 30
"""So many candidates a frame and detector have pictures of their own: the best before or after rescoring."""
_FRAMES_WORTH_A_PROCESS = 12
"""A process takes seconds to start, which fewer frames do not win back."""
_BLOCK = 8
"""So many frames a process are on their way at most: what waits to be written must not grow."""


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """What one frame adds to a recording."""

    tape: Tape
    tile: Tile | None
    """For the sheet; None beyond its last place."""
    view: FrameView | None
    """The frame itself, of the first alone."""


@dataclass(frozen=True, eq=False)
class FrameMaker:
    """Prepares single frames; holds what they share."""

    story: Story
    reader: FrameReader
    model: ClassModel | None
    """For the size of the class."""
    stride: int
    """Steps of the candidates' timeline from one frame to the next."""
    size_px: tuple[int, int]
    """Width and height that pictures are stored with."""

    def make(self, place: int, image_id: int) -> RecordedFrame:
        """The frame at a place of the recording, from 0."""
        view, tape = self.reader.read(image_id), Tape()
        log_frame(tape, view, self.size_px)
        log_boxes(tape, self.story, view)
        log_models(tape, self.story, view, self.model)
        self._log_candidates(tape, place, view)
        tile = Tile.of(self.story, view, self.size_px) if place < MAX_TILES else None
        return RecordedFrame(tape, tile, view if place == 0 else None)

    def _log_candidates(self, tape: Tape, place: int, view: FrameView) -> None:
        """The most telling one comes last: of data at one time of a timeline Rerun shows what came last."""
        for detector, some in view.candidates.items():
            told = [c for c in some if min(c.rank, c.new_rank) < MAX_EXPLAINED]
            best = self.story.most_telling(detector, told)
            order: list[CandidateView] = [c for c in told if c is not best]
            for c in [*order, *([best] if best is not None else [])]:
                tape.set_time(CANDIDATE_TIME, sequence=place * self.stride + c.rank + 1)
                log_candidate(tape, self.story, detector, view, c, self.model)


def recorded_frames(maker: FrameMaker, image_ids: NDArray[int64], jobs: int) -> Iterator[RecordedFrame]:
    """The frames of images in their order, prepared by at most so many processes."""
    places = list(enumerate(image_ids.tolist()))
    jobs = min(jobs, 1 + len(places) // _FRAMES_WORTH_A_PROCESS)
    if jobs == 1:
        yield from (maker.make(*place) for place in places)
        return
    with (
        tempfile.TemporaryDirectory() as scratch,
        Parallel(n_jobs=jobs, return_as="generator", batch_size=1) as parallel,
    ):
        # a file, read once by each process: with every frame it would travel again
        shared = Path(scratch) / "shared.pickle"
        shared.write_bytes(pickle.dumps(maker))
        # joblib gives out more work whether or not the results were taken: block by block they are
        for first in range(0, len(places), _BLOCK * jobs):
            block = places[first : first + _BLOCK * jobs]
            yield from parallel(delayed(_make)(shared, *place) for place in block)


def _make(shared: Path, place: int, image_id: int) -> RecordedFrame:
    with one_thread():
        return _read(shared).make(place, image_id)


@lru_cache(maxsize=1)
def _read(shared: Path) -> FrameMaker:
    maker = pickle.loads(shared.read_bytes())
    assert isinstance(maker, FrameMaker)
    return maker
