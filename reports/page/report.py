"""The report of one run or several: one HTML file that needs no network."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recon.errors import RescoreError
from recon.files import atomic_path
from reports.charts import ChartGroup
from reports.page.figures import curve_group, reliability_group, runs_group, sweep_group, weight_group
from reports.page.gallery import MAX_CARDS, Gallery, build_gallery
from reports.page.headline import Tile, few_images, headline, of_sample, tiles
from reports.page.paired_runs import Evaluated, compare_runs, side_by_side
from reports.page.run_facts import differing_settings, id_table, made_from
from reports.palette import OUTCOME_COLOUR, OUTCOME_NAME, OUTCOMES, SERIES, detector_name, mode_name
from reports.run.candidate_panels import DEPTH_COLOURS, RESIDUAL_COLOURS, colour_stops
from reports.run.curve_pictures import write_curves
from reports.run.curves import curve_sets
from reports.run.tables import (
    Table,
    comparison_table,
    difficulty_table,
    fusion_table,
    kind_table,
    number,
    reason_table,
    reliability_table,
    result_table,
    stereo_table,
    tie_notes,
    weight_table,
)
from reports.run.tables3d import boxes3d_table, error_table, pose_table
from reports.templating import asset, render
from rescore.results.metrics_file import Metrics
from rescore.results.run_folder import Run, load_run, missing_evidence
from rescore.results.sweep_file import read_sweep
from rescore.speech import say

ONE_RUN, SEVERAL_RUNS = "report.html", "comparison.html"
_ROOM = "reports.page"


@dataclass(frozen=True, eq=False)
class Section:
    """What the page shows of one run."""

    name: str
    key: str
    """Prefix of the names of its elements."""
    metrics: Metrics
    headline: str
    warning: str | None
    tiles: tuple[Tile, ...]
    curves: ChartGroup
    band_note: str
    """Why there are no bands; empty where there are."""
    tables: Mapping[str, Table | None]
    gallery: Gallery | None
    gallery_note: str
    """Note on the gallery: why there is none, or what to know of it."""
    mode: str
    """Name of the mode of the gallery."""
    weight: ChartGroup | None
    reliability: ChartGroup | None
    sweep: ChartGroup | None
    can_sweep: bool
    """Whether `rescore sweep` takes such a run."""
    facts: Sequence[tuple[str, str]]
    config_text: str

    @property
    def groups(self) -> tuple[ChartGroup, ...]:
        """All groups of charts of the section."""
        return tuple(g for g in (self.curves, self.weight, self.reliability, self.sweep) if g is not None)


def build_report(run_dirs: Path | Sequence[Path], out: Path | None = None) -> Path:
    """Path of the page that is written on one or several run folders; one run's curves are drawn as PNG too.

    Args:
        run_dirs: one run folder or several; the others are compared with the first.
        out: file to write; by default ``report.html`` of the run folder, and of several runs
            ``comparison.html`` of the first.

    Raises:
        RescoreError: a run folder lacks results, or one is named twice.
    """
    folders = list(run_dirs) if isinstance(run_dirs, Sequence) else [run_dirs]
    runs = [load_run(folder) for folder in folders]
    names = _names([run.root for run in runs])
    for note in (note for run in runs for note in missing_evidence(run)):
        say(f"note: {note}")
    if len(runs) == 1:
        write_curves(runs[0], runs[0].root / "curves")
    page = render_report([Evaluated(n, run) for n, run in zip(names, runs, strict=True)])
    out = out or folders[0] / (ONE_RUN if len(runs) == 1 else SEVERAL_RUNS)
    with atomic_path(out) as beside:
        beside.write_text(page, encoding="utf-8")
    return out


def render_report(runs: Sequence[Evaluated]) -> str:
    """The page of one run or several as text."""
    sections = [_section(one, f"r{i}", MAX_CARDS // len(runs)) for i, one in enumerate(runs)]
    overlay = _overlay(runs) if len(runs) > 1 else None
    groups = [*([overlay] if overlay else []), *(g for s in sections for g in s.groups)]
    return render(
        _ROOM,
        "report.html.j2",
        sections=sections,
        overlay=overlay,
        side_by_side=side_by_side(runs) if len(runs) > 1 else None,
        pairs=compare_runs(runs) if len(runs) > 1 else (),
        differing=differing_settings({one.name: one.run for one in runs}) if len(runs) > 1 else None,
        outcomes=[(OUTCOME_NAME[o], OUTCOME_COLOUR[o]) for o in OUTCOMES],
        depth_stops=colour_stops(DEPTH_COLOURS),
        residual_stops=colour_stops(RESIDUAL_COLOURS),
        number=number,
        tie_notes=tie_notes,
        detector_name=detector_name,
        charts={name: chart for g in groups for name, chart in g.as_json().items()},
        style=asset(_ROOM, "report.css"),
        theme=asset(_ROOM, "theme.js"),
        scripts=[asset(_ROOM, "charts.js"), asset(_ROOM, "report.js")],
    )


def _warnings(run: Run) -> tuple[str | None, ...]:
    sample = of_sample(run.metrics, run.config.config.sample_of_images)
    return sample, few_images(run.metrics), *missing_evidence(run)


def _section(one: Evaluated, key: str, max_cards: int) -> Section:
    run = one.run
    mode = run.modes[-1]
    bands, band_note = _or_note(one.bands, {}, "No bands around the curves")
    gallery, gallery_note = _gallery(run, mode, max_cards)
    sweep = run.folder.sweep
    return Section(
        name=one.name,
        key=key,
        metrics=run.metrics,
        headline=headline(run.metrics),
        warning=" ".join(filter(None, _warnings(run))),
        tiles=tiles(run.metrics),
        curves=curve_group(f"{key}-curves", curve_sets(run), run.metrics, bands),
        band_note=band_note,
        tables=_tables(run),
        gallery=gallery,
        gallery_note=gallery_note,
        mode=mode_name(mode),
        weight=weight_group(f"{key}-weight", run.metrics.tuning),
        reliability=reliability_group(f"{key}-reliability", run.metrics.reliability),
        sweep=sweep_group(f"{key}-sweep", read_sweep(sweep)) if sweep.is_file() else None,
        can_sweep=run.config.config.preset is not None,
        facts=made_from(run),
        config_text=json.dumps(run.config.as_json(), indent=1, ensure_ascii=False),
    )


def _gallery(run: Run, mode: str, max_cards: int) -> tuple[Gallery | None, str]:
    """The gallery, or why there is none."""
    if len(run.modes) < 2:
        return (
            None,
            "No candidate was rescored in this run, so none moved: `rescore apply` rescores detections.",
        )
    gallery, note = _or_note(lambda: build_gallery(run, mode, max_cards), None, "No reasons are told")
    if gallery is None:
        # another model than the one that made D takes the reasons, not the pictures
        bare, why_not = _or_note(lambda: build_gallery(run, mode, max_cards, explained=False), None, "")
        if bare is None:
            return None, f"No pictures of candidates{why_not}"
        gallery = bare
    if gallery is not None and not gallery.movers:
        return None, "No candidate with depth evidence changed its place."
    if gallery is not None and all(m.panels.predicted is None for m in gallery.movers):
        no_depth = (
            f"No predicted depth is shown: {run.root.name} holds no reconstructions; `rescore apply "
            f"--evidence {run.root.name}/evidence` keeps them."
        )
        note = " ".join(filter(None, (note, no_depth)))
    return gallery, note


def _or_note(make: Any, otherwise: Any, what: str) -> tuple[Any, str]:
    """What a function makes, or the substitute with a sentence on why: a page without pictures beats none."""
    try:
        return make(), ""
    except RescoreError as error:
        return otherwise, f"{what}: {error}."


def _overlay(runs: Sequence[Evaluated]) -> ChartGroup:
    """The curves of all runs in one group of charts."""
    colours = {one.name: SERIES[i % len(SERIES)] for i, one in enumerate(runs)}
    return runs_group(
        "all-curves",
        {one.name: curve_sets(one.run) for one in runs},
        colours,
        [one.run.metrics for one in runs],
    )


def _tables(run: Run) -> dict[str, Table | None]:
    ids, _ = _or_note(lambda: id_table(run), None, "")
    return {
        "results": result_table(run.metrics, run.split),
        "comparison": comparison_table(run.metrics),
        "fusion": fusion_table(run.metrics),
        "weights": weight_table(run.metrics),
        "reliability": reliability_table(run.metrics),
        "reasons": reason_table(run.candidates, run.detectors),
        "kinds": kind_table(run.candidates, run.detectors),
        "difficulty": difficulty_table(run.metrics.difficulty),
        "boxes3d": boxes3d_table(run.metrics),
        "errors3d": error_table(run.metrics),
        "poses": pose_table(run.metrics),
        "stereo": stereo_table(run.metrics.stereo),
        "ids": ids,
    }


def _names(roots: Sequence[Path]) -> list[str]:
    """A name for each run folder, as short as tells them apart.

    Raises:
        RescoreError: a folder is named twice.
    """
    places = [root.resolve() for root in roots]
    twice = [str(p) for p in places if places.count(p) > 1]
    if twice:
        raise RescoreError(f"report: expected different run folders, got {twice[0]} twice; name each once")
    depth = 1
    while True:
        names = ["/".join(p.parts[-depth:]) for p in places]
        if len(set(names)) == len(names):
            return names
        depth += 1
