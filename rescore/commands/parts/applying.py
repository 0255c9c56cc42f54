"""What `rescore apply` does: detections rescored into a file, or into a table in parts."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import RescoreError
from rescore.commands.base import read_split, with_share
from rescore.commands.depth_source import evidence_of, source_as_json
from rescore.commands.parts.in_parts import (
    candidates_of,
    frames_to_read,
    source_of_frames,
    tell_failed,
    tell_reused,
)
from rescore.speech import say

if TYPE_CHECKING:
    from rescore.commands.what_rescores import Rescores
    from rescore.engines.executor import Workers
    from rescore.evidence.model import EvidenceModel
    from rescore.evidence.settings import RescoreConfig


@dataclass(frozen=True)
class Applying:
    """What `rescore apply` is to rescore, with what, and where to."""

    dataset: Path
    detections: Path
    out: Path
    split: str
    maps: list[str] | None
    evidence: Path | None
    used: "Rescores"
    suppress: bool
    camera: str | None
    disparities: int | None
    workers: "Workers"

    def to_file(self, adapt_share: bool) -> None:
        """Rescore into a JSON file in COCO's results form."""
        from recon.files import refuse_as_input
        from rescore.evidence.settings import with_camera, with_stereo_for
        from rescore.files import write_provenance
        from rescore.formats.coco import write_rescored
        from rescore.fusion.rescore_frame import Rescoring

        used, out = self.used, self.out
        refuse_as_input(out, (self.dataset, self.dataset / "annotations.json", self.detections))
        data = read_split(self.dataset, self.split, used.settings.class_name, self.maps)
        looked = with_stereo_for(with_camera(used.settings.rescore, self.camera), data, self.disparities)
        finding = Rescoring(looked, predict=self._predicts)
        source, table, detector = evidence_of(
            data, self.detections, used.source, finding, self.workers, self.evidence
        )
        learned, shift = with_share(used.learned, table, adapt_share)
        rescoring = Rescoring(looked, learned, used.w, self.suppress)
        found = rescoring.fuse(table)
        write_rescored(out, detector, found, data, w=rescoring.w, registration=rescoring.mode)
        made_with = self._made_with(looked, learned) | {"log_odds_shift": shift}
        write_provenance(out, "apply", made_with | source_as_json(source), None)
        say(
            _grounds(Counter(dict(zip(table.image_id.tolist(), table.ground.tolist(), strict=True)).values()))
        )
        if self.suppress and table.boxes3d is None:
            say(
                "note: --suppress: no candidate has a 3D box, which takes a class model with a shape space, "
                "a calibrated camera and a ground plane"
            )
        say(f"{_reasons(Counter(found.candidates.status.tolist()))}: {out}")

    def to_parts(self, adapt_share: bool) -> None:
        """Rescore into a folder with a table in parts; parts that are there are kept."""
        from rescore.evidence.settings import with_camera, with_stereo_for
        from rescore.files import write_provenance
        from rescore.formats.parts.forms import RESCORED
        from rescore.formats.parts.table import refuse_as_table
        from rescore.fusion.rescore_frame import Rescoring
        from rescore.fusion.rescore_frames import FrameShared
        from rescore.large.inputs import cameras_of, count_frames, grounds, statuses
        from rescore.large.rescored import RescoreWork, rescore_tasks, write_rescored_table
        from rescore.large.run import RunParts

        if adapt_share:
            raise RescoreError(
                f"--adapt-share: expected --out with a .json file, whose candidates are all looked at first, "
                f"got {self.out}; leave the option out"
            )
        used, split = self.used, self.split
        refuse_as_table(self.out, RESCORED, (self.dataset, self.detections))
        frames = frames_to_read(self.dataset, split, used.settings.class_name, self.maps)
        looked = with_camera(used.settings.rescore, self.camera)
        looked = with_stereo_for(looked, cameras_of(frames, split), self.disparities)
        detector, found = candidates_of(frames, split, self.detections)
        model, files, told = source_of_frames(frames, split, used.source, found)
        folder = None if self.evidence is None else self.evidence / detector
        finding = FrameShared(model, Rescoring(looked, predict=self._predicts), folder)
        work = RescoreWork(finding, Rescoring(looked, used.learned, used.w, self.suppress))
        run = RunParts(self.out, work, work.key, frames.root, self.workers)
        tasks = rescore_tasks(frames, split, found, files)
        parts = run.all(tasks, count_frames(frames, split), f"depth evidence {detector}")
        tell_reused(run)
        table = write_rescored_table(self.out, detector, work, parts)
        write_provenance(self.out, "apply", self._made_with(looked, used.learned) | told, None)
        say(_grounds(grounds(table)))
        say(f"{_reasons(statuses(table))}: {self.out}")
        tell_failed(table)

    @property
    def _predicts(self) -> bool:
        return self.evidence is not None or self.used.mode.predicts

    def _made_with(self, looked: "RescoreConfig", learned: "EvidenceModel | None") -> dict[str, Any]:
        from rescore.evidence.model import models_as_json
        from rescore.experiment.config import part_as_json

        used = self.used
        say(f"used: {used.words}")
        made_with = {"w": used.w, "split": self.split, "registration": used.mode.value, "log_odds_shift": 0.0}
        made_with |= {"rescore": part_as_json(looked), "suppress": self.suppress, "used": used.words}
        if learned is not None:
            # for the words of reports: D cannot be explained without what it was made with
            made_with["evidence_model"] = models_as_json({used.mode: learned})
        return made_with


def _reasons(counts: Counter[str]) -> str:
    """Numbers of candidates by status, in words."""
    total = counts.total()
    second = counts.pop("second_box", 0)
    rest = ", ".join(f"{n} {reason}" for reason, n in sorted(counts.items()) if reason != "ok")
    text = f"{total} candidates, {counts['ok']} with depth evidence" + (f" ({rest})" if rest else "")
    return text + (f", {second} second boxes of a car" if second else "")


def _grounds(counts: Counter[str]) -> str:
    """Numbers of frames by what their ground plane comes from, in words."""
    from recon.camera import DEFAULT_GROUND
    from rescore.data.frames import GroundSource

    known = [counts[source] for source in GroundSource]
    text = (
        f"ground plane of {counts.total()} frames with candidates: {counts[GroundSource.STATED]} stated, "
        f"{counts[GroundSource.STEREO]} from stereo, {counts[GroundSource.DEFAULT]} the default "
        f"({DEFAULT_GROUND.height_m:g} m, level)"
    )
    failed = counts.total() - sum(known)
    text += f", {failed} failed" if failed else ""
    return text + ("; `rescore doctor` says why" if counts[GroundSource.DEFAULT] else "")
