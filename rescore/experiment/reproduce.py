"""The whole experiment: render, learn, train, detect, tune, rescore, evaluate, report; stages are cached."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from recon import part_views
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.learning import learn
from recon.localization import learn_shapes
from recon.view_looks import LooksConfig
from rescore import speech
from rescore.data.frames import DataSet
from rescore.data.splits import Splits
from rescore.detectors import detect, platt
from rescore.detectors.registry import DETECTORS, load_detector, train_detector
from rescore.engines.map_frames import map_frames
from rescore.evidence import fit_model, learn_looks, model
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import LEARNED, Registration
from rescore.experiment.config import RunConfig, part_as_json
from rescore.experiment.stages import Done, Stage, run_stage, run_stage_in_place
from rescore.files import digest_of, write_json
from rescore.formats import coco
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion import rescore_frame, rescore_frames, tune, tuning_file
from rescore.fusion.rescore_frame import Rescoring
from rescore.locks import locked
from rescore.parallel import one_thread
from rescore.results import evaluate, run_config_file
from rescore.results.metrics_file import Metrics, read_metrics
from rescore.results.run_folder import EVIDENCE_TABLE, RunFolder

Report = Callable[[Done], None]


FITTED_ON = ("train", "calibration")
"""Splits that the models of depth evidence are fitted to."""


@dataclass(frozen=True)
class Experiment:
    """A run of the experiment into a folder."""

    folder: RunFolder
    config: RunConfig
    seed: int
    jobs: int
    report: Report
    """Function that is told what became of each stage, after it."""
    train_meshes: Path | None = None
    test_meshes: Path | None = None

    def all(self) -> Metrics:
        """Run every stage that is not done yet; returns the figures.

        Raises:
            RescoreError: another process works in the folder.
        """
        with locked(self.folder.root):
            return self._all()

    def _all(self) -> Metrics:
        self.render()
        self.learn()
        for kind in self.config.detectors:
            self.train(kind)
            for split in (*self._fitted_on(), "validation", "test"):
                if split != "calibration":
                    self.detect(kind, split)
                self.find_evidence(kind, split)
            if self._learned:
                self.fit_evidence(kind)
            for mode in self.config.registrations:
                self.tune(kind, mode)
                self.apply(kind, mode)
        metrics = self.evaluate()
        self.write_report()
        return metrics

    def render(self) -> None:
        """The data set."""
        from datasets_synth import build  # noqa: PLC0415 (open3d takes a second to import)

        meshes = tuple(p for p in (self.train_meshes, self.test_meshes) if p is not None)
        config = {
            "synth": part_as_json(self.config.synth),
            "seed": self.seed,
            "train_meshes": self.train_meshes and str(self.train_meshes),
            "test_meshes": self.test_meshes and str(self.test_meshes),
        }
        stage = Stage("synth", config, meshes, (self.folder.data,), (build,), resumes=True)

        def work(out: Path) -> None:
            build.build_dataset(
                self.config.synth,
                out,
                seed=self.seed,
                jobs=self.jobs,
                train_meshes=self.train_meshes,
                test_meshes=self.test_meshes,
            )

        self.report(run_stage(self.folder.root, stage, work))

    def learn(self) -> None:
        """The class model."""
        views = self.folder.data / "part_views"
        stage = Stage(
            "learn",
            [self.config.class_name, part_as_json(self.config.learn), part_as_json(LooksConfig()), self.seed],
            (views, self.folder.data),
            (self.folder.class_model,),
            (learn, learn_shapes, learn_looks, part_views),
        )

        def work(out: Path) -> None:
            labelled = part_views.load_part_views(views)
            with one_thread():
                learned = learn.learn_class_model(
                    labelled, self.config.class_name, labelled.part_names, self.config.learn
                )
                learned = learn_shapes.with_shape_space(learned, labelled)
                training = self._data().split("train")
                learned = learn_looks.with_looks(learned, training, LooksConfig(), self.seed)
            learned.save(out)

        self.report(run_stage(self.folder.root, stage, work))

    def train(self, kind: str) -> None:
        """One detector, its Platt scaling, and its candidates on the split that the scaling is fitted to."""
        settings, module = self.config.detector_settings[kind], DETECTORS[kind].module
        stage = Stage(
            f"train_{kind}",
            [part_as_json(settings), self.seed],
            (self.folder.data,),
            (self.folder.detector(kind),),
            (module,),
        )
        data = self._data()

        def work(out: Path) -> None:
            train_detector(kind, data, settings, self.seed, self.jobs).save(out)

        self.report(run_stage(self.folder.root, stage, work))
        scaling, detections = self.folder.scaling(kind), self.folder.detections(kind, "calibration")
        stage = Stage(
            f"calibrate_{kind}",
            None,
            (self.folder.detector(kind), self.folder.data),
            (scaling, detections),
            (detect, platt, coco, module),
        )

        def fit() -> None:
            detector = load_detector(self.folder.detector(kind))
            fitted, table = detect.calibrate_and_detect(detector, data, self.jobs)
            platt.save_scaling(scaling, fitted)
            coco.write_detections(detections, kind, table, data.split("calibration"))

        self.report(run_stage_in_place(self.folder.root, stage, fit))

    def detect(self, kind: str, split: str) -> None:
        """The candidates of one detector on a split other than "calibration", whose come with the scaling."""
        detector, scaling = self.folder.detector(kind), self.folder.scaling(kind)
        stage = Stage(
            f"detect_{kind}_{split}",
            split,
            (detector, scaling, self.folder.data),
            (self.folder.detections(kind, split),),
            (detect, platt, coco, DETECTORS[kind].module),
        )

        def work(out: Path) -> None:
            data = self._data().split(split)
            table = detect.detect_candidates(
                load_detector(detector), platt.load_scaling(scaling), data, self.jobs
            )
            coco.write_detections(out, kind, table, data)

        self.report(run_stage(self.folder.root, stage, work))

    def find_evidence(self, kind: str, split: str) -> None:
        """What depth says of the candidates of one detector on one split, in all modes, before w."""
        is_test = split == "test"
        output = self.folder.evidence(kind) if is_test else self.folder.evidence_table(kind, split)
        stage = Stage(
            f"evidence_{kind}_{split}",
            part_as_json(self.config.rescore),
            (self.folder.detections(kind, split), self.folder.class_model, self.folder.data),
            (output,),
            (rescore_frame, rescore_frames, coco),
        )

        def work(out: Path) -> None:
            table = out / EVIDENCE_TABLE if is_test else out
            self._find_evidence(kind, split, table, out if is_test else None)

        self.report(run_stage(self.folder.root, stage, work))

    def fit_evidence(self, kind: str) -> None:
        """The models of depth evidence, from the splits "train" and "calibration"."""
        tables = tuple(self.folder.evidence_table(kind, split) for split in FITTED_ON)
        stage = Stage(
            f"fit_evidence_{kind}",
            part_as_json(self.config.evidence),
            (*tables, self.folder.data / "annotations.json"),
            (self.folder.evidence_model(kind),),
            (fit_model, model, coco),
        )

        def work(out: Path) -> None:
            data = self._data()
            parts = [
                coco.read_detections(t, data.split(s)).table for t, s in zip(tables, FITTED_ON, strict=True)
            ]
            table = CandidateTable.concatenate(parts)
            model.save_models(
                out, fit_model.fit_modes(table, Splits.of(data).fitting_set, self.config.evidence)
            )

        self.report(run_stage(self.folder.root, stage, work))

    def tune(self, kind: str, mode: Registration) -> None:
        """The weight of one detector in one mode, from the validation split."""
        stage = Stage(
            f"tune_{kind}_{mode}",
            [part_as_json(self.config.tune), self.seed],
            (*self._evidence(kind, "validation", mode), self.folder.data / "annotations.json"),
            (self.folder.tuned(kind, mode),),
            (tune, tuning_file, model),
        )

        def work(out: Path) -> None:
            data = self._data()
            table = self._evidence_table(kind, "validation", data)
            judged = self._rescoring(kind, mode).fuse(table).candidates
            tuning = tune.tune_on_validation(kind, judged, data, self.config.tune, mode, self.seed)
            write_json(out, tuning_file.tuning_as_json(tuning))

        self.report(run_stage(self.folder.root, stage, work))

    def apply(self, kind: str, mode: Registration) -> None:
        """The rescored candidates of one detector in one mode on the test split."""
        stage = Stage(
            f"apply_{kind}_{mode}",
            None,
            (
                *self._evidence(kind, "test", mode),
                self.folder.tuned(kind, mode),
                self.folder.data / "annotations.json",
            ),
            (self.folder.rescored(kind, mode),),
            (rescore_frame, coco),
        )

        def work(out: Path) -> None:
            data = self._data()
            rescoring = self._rescoring(kind, mode, tuning_file.load_tuning(self.folder.tuned(kind, mode)).w)
            found = rescoring.fuse(self._evidence_table(kind, "test", data))
            coco.write_rescored(out, kind, found, data, w=rescoring.w, registration=rescoring.mode)

        self.report(run_stage(self.folder.root, stage, work))

    def evaluate(self) -> Metrics:
        """The match table and the figures."""
        root = self.folder.root
        pairs = [(k, m) for k in self.config.detectors for m in self.config.registrations]
        outputs = (self.folder.config, self.folder.candidates, self.folder.metrics)
        stage = Stage(
            "evaluate",
            [self.config.as_json(), self.seed],
            (
                self.folder.data,
                *(self.folder.rescored(k, m) for k, m in pairs),
                *(self.folder.tuned(k, m) for k, m in pairs),
            ),
            outputs,
            (evaluate, run_config_file, coco),
        )

        def work() -> None:
            data = self._data().split("test")
            files = [coco.read_detections(self.folder.rescored(k, m), data) for k, m in pairs]
            tunings = {(str(k), m): tuning_file.load_tuning(self.folder.tuned(k, m)) for k, m in pairs}
            run_config_file.write_run_config(
                self.folder.config,
                "reproduce",
                self.config.as_json(),
                self.seed,
                stereo=self.config.synth.sgbm,
            )
            min_iou = self.config.tune.min_iou
            evaluate.evaluate(data, files, root, tunings=tunings, min_iou=min_iou, seed=self.seed)

        self.report(run_stage_in_place(root, stage, work))
        return read_metrics(self.folder.metrics)

    def write_report(self) -> None:
        """The report with its curves, and the recording, side by side where there are two jobs."""
        shared, jobs = (self.folder, speech.is_quiet()), min(self.jobs, 2)
        with speech.doing("report and log"):
            for done in map_frames(_write, (_write_page, _write_recording), shared, jobs):
                self.report(done)

    @property
    def _learned(self) -> bool:
        return any(mode in LEARNED for mode in self.config.registrations)

    def _fitted_on(self) -> tuple[str, ...]:
        return FITTED_ON if self._learned else ()

    def _evidence(self, kind: str, split: str, mode: Registration) -> tuple[Path, ...]:
        """The files that decide D of a mode."""
        table = self.folder.evidence_table(kind, split)
        return (table, self.folder.evidence_model(kind)) if mode in LEARNED else (table,)

    def _rescoring(self, kind: str, mode: Registration, w: float = 1.0) -> Rescoring:
        """How candidates of a detector are rescored in a mode."""
        models = model.load_models(self.folder.evidence_model(kind)) if mode in LEARNED else {}
        if mode in LEARNED and mode not in models:
            raise RescoreError(
                f"registrations: expected candidates with cue {mode.needs!r} for mode {mode}, got none; leave"
                " the mode out, or have calibrated cameras and, for instance, seven part-labelled cars"
            )
        return Rescoring(self.config.rescore, models.get(mode), w)

    def _evidence_table(self, kind: str, split: str, data: DataSet) -> CandidateTable:
        """The candidates of a split with their evidence in all modes."""
        return coco.read_detections(self.folder.evidence_table(kind, split), data.split(split)).table

    def _find_evidence(self, kind: str, split: str, out: Path, npz_dir: Path | None) -> None:
        data = self._data().split(split)
        # with w = 1 the likelihoods stay: D of each mode and w come later
        rescoring = Rescoring(self.config.rescore)
        found = rescore_frames.rescore_frames(
            data,
            coco.read_detections(self.folder.detections(kind, split), data).candidates(data),
            ClassModel.load(self.folder.class_model),
            rescoring,
            jobs=self.jobs,
            evidence_dir=npz_dir,
            progress=f"depth evidence {kind}",
        )
        coco.write_rescored(out, kind, found, data, w=rescoring.w, registration=rescoring.mode)

    def _data(self) -> DataSet:
        return read_dataset(self.folder.data, self.config.class_name)


def _write(work: Callable[[RunFolder, bool], Done], shared: tuple[RunFolder, bool]) -> Done:
    return work(*shared)


def _write_page(folder: RunFolder, quiet: bool) -> Done:
    """The report, in whatever process this is."""
    from reports.page import report as page  # noqa: PLC0415 (matplotlib and rerun take a second to import)

    speech.silence(quiet)
    outputs = (folder.html, folder.curves)
    return _draw(folder, "report", page, outputs, lambda: _ignore(page.build_report(folder.root)))


def _write_recording(folder: RunFolder, quiet: bool) -> Done:
    """The recording, in whatever process this is."""
    from reports.recording import log  # noqa: PLC0415

    speech.silence(quiet)
    file = folder.recording
    return _draw(folder, "log", log, (file,), lambda: _ignore(log.write_recording(folder.root, file)))


def _draw(
    folder: RunFolder, name: str, module: ModuleType, outputs: tuple[Path, ...], work: Callable[[], None]
) -> Done:
    """A stage that draws what the run folder holds; the words of its templates are part of its code."""
    shown = (folder.config, folder.candidates, folder.metrics)
    folders = tuple(folder.root / name for name in ("evidence", "data", "models", "sweep"))
    assert module.__file__ is not None
    words = {"templates": digest_of(Path(module.__file__).with_name("templates"))}
    stage = Stage(name, words, (*shown, *folders), outputs, (module,))
    return run_stage_in_place(folder.root, stage, work)


def _ignore(_result: object) -> None:
    """Drop a result that nobody needs."""
