"""The recording of a run for the Rerun viewer: frames in 2D and 3D, candidates and why they moved, curves."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr

from recon.arrays import IntArray
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.files import atomic_path
from reports.palette import mode_name
from reports.recording.blueprint import blueprint, recorded_plots
from reports.recording.boxes import log_boxes
from reports.recording.boxes3d import log_boxes3d
from reports.recording.candidate import log_candidate, log_models
from reports.recording.entities import (
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
from reports.recording.frame import DEPTH_RANGE_M, log_frame
from reports.recording.story import Frames, Story, choose_frames
from reports.recording.threshold import MAX_TILES, SheetTile, log_default_points, log_sheet, log_thresholds
from reports.run.curves import CARS
from reports.run.frame_view import CandidateView, FrameReader, FrameView
from reports.run.tables import short_table
from reports.templating import render
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread, track
from rescore.results.run_folder import Run, load_run, missing_evidence
from rescore.speech import say

APPLICATION_ID = "rescore"
_CHUNK_BYTES = 2**19
"""Bytes that an entity holds back before it is written: what is held must not grow with the frames."""
_FRAMES_HELD = 8
"""Frames after which all is written that entities hold back: there are hundreds of them."""
_TRIES, _PATIENCE_S = 12, 5.0
_ROOM_BYTES = 2**26
"""Free room that is kept: more than what is logged between two looks at it."""
_END_MARK = b"RRF2FOOT"
_END = _END_MARK + b"\1\0\0\0"
"""Last bytes of a recording that is whole."""
MAX_EXPLAINED = 30
"""Candidates of a frame and detector that have pictures of their own: the best before or after rescoring."""


def write_recording(
    run_dir: Path,
    out: Path | None = None,
    frames: Frames = Frames.ALL,
    max_frames: int | None = None,
    mode: str | None = None,
    show: bool = True,
    jobs: Workers = 1,
) -> Path:
    """Write the recording of a run; frames are streamed, so memory does not grow with their number.

    Frames are read and measured by ``jobs``, and recorded here one after another, since a recording is one
    stream.

    Args:
        run_dir: the run folder.
        out: the file to write; None for ``recording.rrd`` in the run folder.
        frames: which frames are shown.
        max_frames: at most so many of them; None for all.
        mode: the way of scoring that is explained; None for the last of metrics.json.
        show: whether to show a progress bar.
        jobs: who reads the frames; the recording is the same for any.

    Returns:
        The path written.

    Raises:
        RescoreError: not a run folder, no such mode, or no frame of the kind.
    """
    story = Story.of(load_run(run_dir), mode)
    for note in missing_evidence(story.run):
        say(f"note: {note}")
    chosen = choose_frames(story, frames, max_frames)
    out = Path(out) if out is not None else story.run.root / "recording.rrd"
    with atomic_path(out) as beside:
        # time-dependent batches would cut the same data in other places on every run
        batches = rr.ChunkBatcherConfig(flush_tick=3600.0, flush_num_bytes=_CHUNK_BYTES)
        rec = rr.RecordingStream(
            APPLICATION_ID, recording_id=story.run.root.name, send_properties=False, batcher_config=batches
        )
        rr.set_log_time_enabled(False, recording=rec)
        with _told_where_it_cannot_write(out):
            try:
                _Writer(rec, story).write(beside, chosen, show, jobs)
                _flush(rec, beside)
            finally:
                # one that is still connected to a full disk may keep the process from ending
                rec.disconnect()
            _refuse_cut(beside)
    return out


@contextmanager
def _told_where_it_cannot_write(out: Path) -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:
        why = " ".join(str(error).split())
        raise RescoreError(
            f"{out}: expected to write here, got {why!r}; make room or choose another place"
        ) from error


def _refuse_full(file: Path) -> None:
    """Raises RuntimeError where the disk is nearly full: Rerun, which writes, would not say so."""
    left = shutil.disk_usage(file.parent).free
    if left < _ROOM_BYTES:
        raise RuntimeError(
            f"a disk with {left / 2**20:.0f} MB left, at least {_ROOM_BYTES // 2**20} are needed"
        )


def _flush(rec: rr.RecordingStream, file: Path) -> None:
    """Write what was logged so far to the file.

    Raises:
        RuntimeError: the disk is nearly full, or the thread of Rerun that writes has ended or is stuck.
    """
    _refuse_full(file)
    for left in reversed(range(_TRIES)):
        # without an end, Rerun may wait for ever for a thread that is no more
        try:
            rec.flush(timeout_sec=_PATIENCE_S)
            return
        except RuntimeError:
            if not left:
                raise


def _refuse_cut(file: Path) -> None:
    """Raises RuntimeError where a recording lacks its end."""
    with file.open("rb") as written:
        written.seek(max(0, file.stat().st_size - len(_END)))
        if not written.read().startswith(_END_MARK):
            raise RuntimeError("a recording without its end")


class _Writer:
    """Logs one run, frame after frame."""

    def __init__(self, rec: rr.RecordingStream, story: Story) -> None:
        self.rec, self.story = rec, story
        most = max((_most_candidates(story.run, d) for d in story.run.detectors), default=0)
        self.stride = 10 ** len(str(max(most, 9)))
        """Steps of the candidates' timeline from one frame to the next: a power of ten, so that the last
        digits are the place and the others the frame."""

    def write(self, path: Path, chosen: IntArray, show: bool, jobs: Workers) -> None:
        """Log everything."""
        rec, story = self.rec, self.story
        records = {f.image_id: f for f in story.data.frames}
        shown = [records[i] for i in chosen.tolist()]
        size = max(f.width_px for f in shown), max(f.height_px for f in shown)
        right = any(f.right_path is not None and f.right_path.is_file() for f in shown)
        plots = recorded_plots(story)
        _refuse_full(path)
        rec.save(path, default_blueprint=blueprint(story, plots, size, len(chosen), right))
        self._log_static()
        for plot in (p for of_kind in plots.values() for p in of_kind.values()):
            plot.log(rec)
        # names, colours and texts come first in the file, not when enough of them has gathered
        _flush(rec, path)
        tiles: list[SheetTile] = []
        first: FrameView | None = None
        others = [m for m in story.run.modes if m != story.mode]
        reader = FrameReader(story.run, story.data, story.mode, others)
        model = _class_model(story.run)
        views = map_frames(_read, chosen.tolist(), reader, jobs)
        for i, view in enumerate(track(views, "recording", len(chosen), show)):
            self._set_frame(i, view.image_id)
            if i == 0:
                first = view
                # what the threshold's timeline shows of all that does not depend on it
                rec.set_time(THRESHOLD_TIME, sequence=0)
                log_default_points(rec, story, plots[CARS])
            if i < MAX_TILES:
                tiles.append(SheetTile.of(story, view, size))
            log_frame(rec, view, size)
            log_boxes(rec, story, view, size[0])
            log_boxes3d(rec, story, view)
            log_models(rec, story, view, model)
            self._log_candidates(i, view, model)
            if i % _FRAMES_HELD == _FRAMES_HELD - 1:
                _flush(rec, path)
        if first is not None:
            rec.reset_time()
            self._set_frame(0, first.image_id)
            for detector in story.run.detectors:
                log_sheet(rec, detector, tiles, None, whole=True)
            log_thresholds(rec, story, plots[CARS], first, tiles)

    def _log_candidates(self, place: int, view: FrameView, model: ClassModel | None) -> None:
        """The most telling one comes last: of data at one time of a timeline Rerun shows what came last."""
        for detector, some in view.candidates.items():
            told = [c for c in some if min(c.rank, c.new_rank) < MAX_EXPLAINED]
            best = self.story.most_telling(detector, told)
            order: list[CandidateView] = [c for c in told if c is not best]
            for c in [*order, *([best] if best is not None else [])]:
                self.rec.set_time(CANDIDATE_TIME, sequence=place * self.stride + c.rank + 1)
                log_candidate(self.rec, self.story, detector, view, c, model)

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


def _read(image_id: int, reader: FrameReader) -> FrameView:
    """A frame of the run, with its pictures and measured depth."""
    with one_thread():
        return reader.read(image_id)


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
        fits=any(story.shows_fits(d) for d in story.run.detectors),
        missing=missing_evidence(story.run),
        point=story.points[story.run.detectors[0]].text,
        low=low,
        high=high,
        stride=stride,
        several=len(story.run.detectors) > 1,
    )
