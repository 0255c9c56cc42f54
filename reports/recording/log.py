"""The recording of a run for the Rerun viewer: frames in 2D and 3D, candidates and why they moved, curves."""

import pickle
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import rerun as rr
from joblib import Parallel, delayed
from numpy import int64
from numpy.typing import NDArray

from recon.arrays import IntArray
from recon.class_model import ClassModel
from reports.palette import mode_name
from reports.recording.blueprint import blueprint
from reports.recording.boxes import log_boxes
from reports.recording.candidate import log_candidate, log_models
from reports.recording.curves import curve_plots, weight_plots
from reports.recording.frame import DEPTH_RANGE_M, log_frame
from reports.recording.names import (
    CANDIDATE_TIME,
    FRAME_TIME,
    IMAGE,
    IMAGE_TIME,
    THRESHOLD_TIME,
    WORLD,
    outcome_context,
    part,
    part_context,
    text,
)
from reports.recording.story import Frames, Story, choose_frames
from reports.recording.tape import Tape
from reports.recording.threshold import MAX_TILES, Tile, log_default_points, log_sheet, log_thresholds
from reports.run.frame_view import CandidateView, FrameReader, FrameView
from reports.run.tables import short_table
from reports.templating import render
from rescore.files import atomic_path
from rescore.parallel import one_thread, track
from rescore.results.run_folder import Run, load_run

MAX_EXPLAINED = 30
"""Largest number of candidates a frame and detector with pictures of their own: the best before or after
rescoring."""


_FRAMES_WORTH_A_PROCESS = 12
"""A process takes seconds to start, which fewer frames do not win back."""


_BLOCK = 8
"""At most this many frames per process are in flight, so that memory stays bounded."""


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """What one frame adds to a recording."""

    tape: Tape
    tile: Tile | None
    """Tile of the frame for the sheet; None beyond the sheet's last place."""
    view: FrameView | None
    """The frame itself, of the first alone."""


@dataclass(frozen=True, eq=False)
class FrameMaker:
    """Prepares single frames; holds what they share."""

    story: Story
    reader: FrameReader
    model: ClassModel | None
    """Class model, for the size of the class."""
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
    """The frames of images in their order, prepared by at most ``jobs`` processes."""
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


APPLICATION_ID = "rescore"
_CHUNK_BYTES = 2**19
"""An entity holds back so much before it is written: what is held must not grow with the frames."""


def write_recording(
    run_dir: Path,
    out: Path | None = None,
    frames: Frames = Frames.ALL,
    max_frames: int | None = None,
    mode: str | None = None,
    show: bool = True,
    jobs: int = 1,
) -> Path:
    """Write the recording of a run; frames are streamed, so memory does not grow with their number.

    Args:
        run_dir: the run folder.
        out: the file to write; None for ``recording.rrd`` in the run folder.
        frames: which frames are shown.
        max_frames: at most so many of them; None for all.
        mode: the way of scoring that is explained; None for the last of metrics.json.
        show: whether to show a progress bar.
        jobs: so many frames are prepared at a time, each by a process of its own.

    Returns:
        The path written.

    Raises:
        RescoreError: not a run folder, no such mode, or no frame of the kind.
    """
    story = Story.of(load_run(run_dir), mode)
    chosen = choose_frames(story, frames, max_frames)
    out = Path(out) if out is not None else story.run.root / "recording.rrd"
    with atomic_path(out) as beside:
        # time-dependent batches would cut the same data in other places on every run
        batches = rr.ChunkBatcherConfig(flush_tick=3600.0, flush_num_bytes=_CHUNK_BYTES)
        rec = rr.RecordingStream(
            APPLICATION_ID, recording_id=story.run.root.name, send_properties=False, batcher_config=batches
        )
        rr.set_log_time_enabled(False, recording=rec)
        _Writer(rec, story, jobs).write(beside, chosen, show)
        rec.flush()
        rec.disconnect()
    return out


class _Writer:
    """Logs one run, frame after frame."""

    def __init__(self, rec: rr.RecordingStream, story: Story, jobs: int) -> None:
        self.rec, self.story, self.jobs = rec, story, jobs
        most = max((_most_candidates(story.run, d) for d in story.run.detectors), default=0)
        self.stride = 10 ** len(str(max(most, 9)))
        """Steps of the candidates' timeline from one frame to the next: a power of ten, so that the last
        digits are the place and the others the frame."""

    def write(self, path: Path, chosen: IntArray, show: bool) -> None:
        """Log everything."""
        rec, story = self.rec, self.story
        records = {f.image_id: f for f in story.data.frames}
        shown = [records[i] for i in chosen.tolist()]
        size = max(f.width_px for f in shown), max(f.height_px for f in shown)
        right = any(f.right_path is not None and f.right_path.is_file() for f in shown)
        plots, weights = curve_plots(story), weight_plots(story)
        rec.save(path, default_blueprint=blueprint(story, plots, weights, size, len(chosen), right))
        self._log_static()
        for plot in [p for own in plots.values() for p in (own.cars, own.candidate, own.precision)]:
            plot.log(rec)
        for plot in weights:
            plot.log(rec)
        # names, colours and texts come first in the file, not when enough of them has gathered
        rec.flush()
        tiles: list[Tile] = []
        first: FrameView | None = None
        others = [m for m in story.run.modes if m != story.mode]
        reader = FrameReader(story.run, story.data, story.mode, others)
        maker = FrameMaker(story, reader, _class_model(story.run), self.stride, size)
        frames = recorded_frames(maker, chosen, self.jobs)
        for i, frame in enumerate(track(frames, "recording", len(chosen), show)):
            self._set_frame(i, int(chosen[i]))
            if i == 0:
                first = frame.view
                # what the threshold's timeline shows of all that does not depend on it
                rec.set_time(THRESHOLD_TIME, sequence=0)
                log_default_points(rec, story, plots)
            if frame.tile is not None:
                tiles.append(frame.tile)
            frame.tape.play(rec)
        if first is not None:
            rec.reset_time()
            self._set_frame(0, first.image_id)
            for detector in story.run.detectors:
                log_sheet(rec, detector, tiles, None, whole=True)
            log_thresholds(rec, story, plots, first, tiles)

    def _set_frame(self, i: int, image_id: int) -> None:
        self.rec.reset_time()
        self.rec.set_time(FRAME_TIME, sequence=i)
        self.rec.set_time(CANDIDATE_TIME, sequence=i * self.stride)
        self.rec.set_time(IMAGE_TIME, sequence=image_id)

    def _log_static(self) -> None:
        rec, story = self.rec, self.story
        rec.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rec.log(WORLD, part_context(story.run.part_names()), static=True)
        for detector in story.run.detectors:
            rec.log(f"{IMAGE}/{part(detector)}", outcome_context(), static=True)
        rec.log("guide", text(_guide(story, self.stride)), static=True)
        rec.log(
            "results", text(short_table(story.run.metrics, ("0.5", "0.7", "0.8")).markdown()), static=True
        )


def _most_candidates(run: Run, detector: str) -> int:
    counts = np.unique(run.of(detector)["image_id"], return_counts=True)[1]
    return int(counts.max(initial=0))


def _class_model(run: Run) -> ClassModel | None:
    """The class model of the run folder, for the size of the class; None where it holds none."""
    path = run.class_model_path()
    return None if path is None else ClassModel.load(path)


def _guide(story: Story, stride: int) -> str:
    """How to read the recording, as Markdown."""
    low, high = (f"{v:g}" for v in DEPTH_RANGE_M)
    return render(
        "reports.recording",
        "guide.md.j2",
        metrics=story.run.metrics,
        mode=mode_name(story.mode),
        other_system=story.run.other_system,
        point=story.points[story.run.detectors[0]].text,
        low=low,
        high=high,
        stride=stride,
        several=len(story.run.detectors) > 1,
    )
