"""The commands ``rescore sweep`` and ``rescore study-evidence``: where depth evidence breaks, and why."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import ALL_PROCESSORS, Jobs, Seed, app
from rescore.speech import say

FinishedRunFolder = Annotated[Path, typer.Argument(help="Folder that `rescore reproduce` has finished.")]
DetectorName = Annotated[str, typer.Option(help="Detector of the run, such as hog.")]
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
    from reports.studies.sweep import write_sweep_page
    from rescore.studies.degradations import dials_named
    from rescore.studies.sweep import sweep_run

    chosen = dials_named(dials, levels)
    value = sweep_run(run, out, chosen, frames, detector=detector, seed=seed, jobs=jobs)
    say(f"sweep: {write_sweep_page(value, out)}")


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
    from reports.studies.distractors import draw_bank
    from reports.studies.evidence import write_evidence_page
    from reports.studies.sweep import write_sweep_page
    from rescore.studies.ablation import ablate_run
    from rescore.studies.degradations import dials_named
    from rescore.studies.distractors import judge_bank_of_run
    from rescore.studies.sweep import sweep_run

    bank, first = judge_bank_of_run(run, out, things, detector=detector, seed=seed, jobs=jobs)
    draw_bank(out, bank, first)
    ablation = ablate_run(run, out, detector, seed)
    dials = dials_named(None, None)
    swept = sweep_run(run, out / "sweep", dials, frames, detector=detector, seed=seed, jobs=jobs)
    write_sweep_page(swept, out / "sweep")
    shortened = "" if frames is None else f" --frames {frames}"
    command = f"rescore study-evidence {run} --out {out} --things {things} --detector {detector}{shortened}"
    say(f"evidence: {write_evidence_page(out, command, bank, ablation, swept)}")
