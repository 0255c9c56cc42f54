"""The commands ``rescore sweep`` and ``rescore study-evidence``: where depth evidence breaks, and why."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rescore.commands.base import ALL_PROCESSORS, Jobs, Seed, app, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rescore.studies.ablation import AblationRow
    from rescore.studies.degrade import Dial
    from rescore.studies.distractors import BankResult, Judged

FinishedRunFolder = Annotated[Path, typer.Argument(help="Folder that `rescore reproduce` has finished.")]
DetectorName = Annotated[str, typer.Option(help="Detector of the run: hog or boosted.")]
Frames = Annotated[int | None, typer.Option(min=2, help="Test frames to use.", show_default="all")]


Things = Annotated[int, typer.Option(min=2, help="Things of each kind in the bank of distractors.")]


@app.command()
def sweep(
    run: FinishedRunFolder,
    out: Annotated[Path, typer.Option(help="Folder for sweep.json, the curves and README.md.")],
    dials: Annotated[str | None, typer.Option(help="Dials, comma-separated; all of them else.")] = None,
    levels: Annotated[str | None, typer.Option(help="Levels of the one dial that is named.")] = None,
    frames: Frames = None,
    detector: DetectorName = "hog",
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """Spoil the input of a run's test frames step by step, and measure what is left of the gain.

    Stereo and evidence are computed again; detector, models and weights stay those of the run.

    Example: [bold]rescore sweep runs/paper --out runs/sweep --dials noise,destroyed[/bold]
    """
    from rescore.studies.degrade import dials_named

    chosen = dials_named(dials, levels)
    page = _sweep(run, out, chosen, frames, detector=detector, seed=seed, jobs=jobs)
    say(f"sweep: {page}")


@app.command("study-evidence")
def study_evidence(
    run: FinishedRunFolder,
    out: Annotated[Path, typer.Option(help="Folder for README.md, tables and pictures.")],
    frames: Frames = None,
    things: Things = 40,
    detector: DetectorName = "hog",
    seed: Seed = 0,
    jobs: Jobs = ALL_PROCESSORS,
) -> None:
    """What the depth evidence of a run is worth, what it takes for a car, and where it breaks.

    A bank of rendered distractors, the evidence fitted again without each of its parts, and a sweep over
    every dial of `rescore sweep`.

    Example: [bold]rescore study-evidence runs/paper --out reports/published/evidence[/bold]
    """
    from rescore.studies.degrade import dials_named

    distractors = _distractors(run, out, things, detector=detector, seed=seed, jobs=jobs)
    ablation = _ablation(run, out, detector, seed)
    _sweep(run, out / "sweep", dials_named(None, None), frames, detector=detector, seed=seed, jobs=jobs)
    shortened = "" if frames is None else f" --frames {frames}"
    command = f"rescore study-evidence {run} --out {out} --things {things} --detector {detector}{shortened}"
    page = _write_page(out, command, distractors, ablation)
    say(f"evidence: {page}")


def _distractors(run: Path, out: Path, things: int, *, detector: str, seed: int, jobs: int) -> "BankResult":
    """Judge the bank of distractors; writes distractors.json and two pictures."""
    from datasets_synth.photos.distractor_bank import BankConfig
    from datasets_synth.photos.distractor_kinds import KIND
    from reports.studies.distractors import Example, draw_boxes, draw_examples
    from rescore.experiment.config import run_config
    from rescore.parallel import track
    from rescore.studies.distractors import Judge, bank_result, judge_bank, write_bank
    from rescore.studies.finished_run import finished_run
    from rescore.studies.sweep import RECALL

    finished = finished_run(run, detector, None)
    judge = Judge(finished.class_model, finished.config, finished.models)
    config = BankConfig(synth=run_config(run).synth)
    judged: list[Judged] = []
    examples = []
    bank = judge_bank(judge, tuple(KIND), things, config, seed, jobs)
    for one in track(bank, "distractors", things * len(KIND)):
        if one.item and one.kind not in {j.kind for j in judged}:
            caption = ", ".join(f"{mode} {d:.2f}" for mode, d in one.difference.items())
            left, disparity = one.item.frame.left_rgb, one.item.frame.disparity_px
            examples.append(Example(KIND[one.kind].title, caption, left, disparity, one.item.xyxy_px))
        judged.append(one.without_pictures())
    bank_of_all = bank_result(judged, RECALL)
    write_bank(out / "distractors.json", bank_of_all)
    draw_boxes(out / "distractors.png", bank_of_all)
    draw_examples(out / "examples.png", examples)
    return bank_of_all


def _ablation(run: Path, out: Path, detector: str, seed: int) -> "tuple[AblationRow, ...]":
    """Fit the evidence again without each of its parts; writes ablation.json."""
    from rescore.data.splits import Splits
    from rescore.evidence.candidates import CandidateTable
    from rescore.experiment.config import run_config
    from rescore.experiment.reproduce import FITTED_ON
    from rescore.formats.coco import read_detections
    from rescore.formats.coco_dataset import read_dataset
    from rescore.results.run_folder import RunFolder
    from rescore.studies.ablation import AblationInput, ablate, write_ablation

    folder, config = RunFolder(run), run_config(run)
    data = read_dataset(folder.data, config.class_name)

    def table(split: str) -> CandidateTable:
        return read_detections(folder.evidence_table(detector, split), data.split(split)).table

    fitting = CandidateTable.concatenate([table(split) for split in FITTED_ON])
    given = AblationInput(Splits.of(data), fitting, table("validation"), table("test"))
    rows = ablate(given, config.evidence, config.tune, seed)
    write_ablation(out / "ablation.json", rows)
    return rows


def _write_page(
    out: Path, command: str, distractors: "BankResult", ablation: "Sequence[AblationRow]"
) -> Path:
    """README.md of the study."""
    from reports.studies.evidence import evidence_text
    from rescore.files import atomic_path
    from rescore.results.sweep_file import read_sweep

    sweep_value = read_sweep(out / "sweep" / "sweep.json")
    with atomic_path(out / "README.md") as beside:
        beside.write_text(evidence_text(command, distractors, ablation, sweep_value))
    return out / "README.md"


def _sweep(
    run: Path,
    out: Path,
    dials: "Sequence[Dial]",
    frames: int | None,
    *,
    detector: str,
    seed: int,
    jobs: int,
) -> Path:
    """Sweep, write sweep.json and draw; returns the page."""
    from reports.studies.sweep import write_sweep_page
    from rescore.files import write_provenance
    from rescore.results.sweep_file import SweepResult, write_sweep
    from rescore.studies.finished_run import finished_run
    from rescore.studies.sweep import SweepConfig, by_visibility, swept_dials, tables_of_steps
    from rescore.studies.sweep import sweep as sweep_dials

    finished = finished_run(run, detector, frames)
    config = SweepConfig(seed=seed, jobs=jobs)
    points = sweep_dials(finished, dials, config)
    as_is = tables_of_steps(finished, [(None, 0.0)], config)[0]
    result = SweepResult(
        detector=detector,
        n_images=len(finished.data.frames),
        dials=swept_dials(points, dials),
        visibility=by_visibility(finished, as_is, config),
    )
    write_sweep(out / "sweep.json", result)
    settings = {"dials": {d.name: d.levels for d in dials}, "frames": frames, "detector": detector}
    write_provenance(out / "sweep.json", "sweep", settings, seed)
    return write_sweep_page(result, out)
