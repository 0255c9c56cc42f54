"""Why each candidate rose or fell, in words with numbers: what the parts of its depth evidence say."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.errors import Reason, RescoreError
from rescore.cues.look_alikes import look_alike
from rescore.cues.surroundings import SurroundingsConfig
from rescore.evidence.candidates import NOT_RESCORED, OK
from rescore.evidence.cues import CUES, cue_column, cue_names
from rescore.evidence.guarded import GuardedConfig
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.results.candidate_file import Columns, difference, status
from rescore.results.words import favourable, range_text, status_text, words_of

TOLD = 3
"""Largest number of cues named in an explanation."""

_DOUBTED = 0.5
"""From this D on depth says that it is no car."""


@dataclass(frozen=True)
class ExplainConfig:
    """What turns cues into metres and knows their bounds: the settings of the run."""

    height_m: float | None = SurroundingsConfig().size_m[2]
    """Height of the class; None where it is not known."""
    scale_limits: tuple[float, float] = GuardedConfig().scale_limits
    """Bounds of the scale of the guarded fit."""


@dataclass(frozen=True)
class EvidencePart:
    """What one cue says of a candidate."""

    cue: str
    """A name of ``rescore.evidence.cues.CUES``."""
    value: float
    """Value of the cue as stored, see ``rescore.cues.surroundings`` and ``rescore.evidence.guarded``."""
    log_odds: float
    """What the cue adds to the log odds that the candidate is a car."""
    text: str
    """The cue in words, for people."""


@dataclass(frozen=True)
class Explanation:
    """Why a candidate has its D."""

    text: str
    """The explanation in one line."""
    parts: tuple[EvidencePart, ...] = ()
    """All cues that say something, those that say most first; empty in mode ``paper``, without evidence, and
    where the model of the evidence is not known."""


def explain(
    rows: Columns,
    mode: str,
    rose: BoolArray,
    model: EvidenceModel | None = None,
    config: ExplainConfig | None = None,
    stayed: BoolArray | None = None,
) -> tuple[Explanation, ...]:
    """Why each candidate (n,) of one detector rose or fell in a mode.

    Args:
        rows: its rows of candidates.parquet.
        mode: a way of rescoring that the rows have.
        rose: of which candidates what speaks for a car is told, shape (n,), such as ``Changes.rose``; of the
            others, what speaks against.
        model: what D was made with, in the modes that learn it; None where it is not known.
        config: settings of the run; None for the defaults.
        stayed: candidates that neither rose nor fell, shape (n,), such as ``Changes.stayed``; of these what
            their own depth says is told, whatever ``rose`` has. None where all moved.

    Raises:
        RescoreError: the model is that of another mode or does not give the D of the rows.
    """
    d, why = difference(rows, mode), status(rows, mode)
    # the detail is that of eq. 6: what another mode lacks can have another cause
    detail = np.where(why == rows["status"], rows.get("reason_detail", ""), "")
    cues = cues_of(rows)
    told = _Teller(mode, model, config or ExplainConfig())
    if model is not None:
        _check_model(model, mode, cues, d, np.asarray(why == OK))
        weights = model.contributions(cues)
    else:
        weights = np.zeros_like(cues)
    has = (why == OK) & np.isfinite(d)
    median = float(np.median(d[has])) if has.any() else float("nan")
    stays = np.zeros(len(d), dtype=bool) if stayed is None else stayed
    found: list[Explanation] = []
    for i in range(len(d)):
        if not has[i]:
            text = told.without_evidence(
                str(why[i]), str(detail[i] or ""), cues[i], bool(rose[i] or stays[i])
            )
            found.append(Explanation(text))
            continue
        head = f"D {d[i]:.3f} (median {median:.3f})"
        if mode == Registration.PAPER or model is None:
            found.append(Explanation(head + (f", {_eq_6(rows, i)}" if mode == Registration.PAPER else "")))
            continue
        parts = told.parts(cues[i], weights[i])
        up = sum(p.log_odds for p in parts) > 0 if stays[i] else bool(rose[i])
        kind = "" if up or d[i] < _DOUBTED else told.taken_for(cues[i])
        found.append(Explanation(f"{told.leading(parts, float(d[i]), up)}{kind}", parts))
    return tuple(found)


def cues_of(rows: Columns) -> FloatArray:
    """Cues (n, k) of table rows, columns ``CUES``; NaN where the table lacks one."""
    nothing = np.full(len(rows["image_id"]), np.nan)
    return np.stack([np.asarray(rows.get(f"cue_{name}", nothing), float) for name in CUES], axis=1)


def _check_model(model: EvidenceModel, mode: str, cues: FloatArray, d: FloatArray, has: BoolArray) -> None:
    """Refuse a model that says something else than the D of the rows: its words would be made up."""
    if model.registration.value != mode:
        raise RescoreError(f"depth evidence: expected the model of mode {mode}, got {model.registration}")
    own = model.difference(cues)[has]
    off = ~(np.abs(own - d[has]) <= 1e-4)
    if off.any():
        raise RescoreError(
            f"depth evidence ({mode}): expected the model that made D of these candidates, got another: "
            f"{int(off.sum())} of {len(off)} differ; name the right one with --evidence-model"
        )


def _eq_6(rows: Columns, i: int) -> str:
    """What eq. 6 found for row i."""
    scale = float(rows["scale"][i])
    text = f"a1 {scale:+.3f}"
    if "offset" in rows:
        text += f", a2 {float(rows['offset'][i]):+.2f}"
    if scale < 0:
        text += ": fits turned inside out"
    if "valid_share" in rows:
        text += f", {1 - float(rows['valid_share'][i]):.0%} of stereo missing".replace("%", " %")
    return text


class _Teller:
    """Words for the cues of candidates in one mode."""

    def __init__(self, mode: str, model: EvidenceModel | None, config: ExplainConfig) -> None:
        self.mode, self.model, self.config = mode, model, config
        self.log_limits = np.log(config.scale_limits)
        self.words = {cue: words_of(cue, config.height_m) for cue in CUES}
        self.ranges = {
            cue: favourable(knots, log_odds)
            for cue, knots, log_odds in ([] if model is None else _functions(model))
        }

    def parts(self, cues: FloatArray, weights: FloatArray) -> tuple[EvidencePart, ...]:
        """What the cues (k,) of a candidate say, by what they add to its log odds (k,)."""
        order = [int(j) for j in np.argsort(-np.abs(weights), kind="stable") if weights[j] != 0]
        names = cue_names()
        return tuple(
            EvidencePart(names[j], float(cues[j]), float(weights[j]), self._text(names[j], float(cues[j])))
            for j in order
        )

    def _text(self, cue: str, value: float) -> str:
        words = self.words[cue]
        text = words.told(value)
        if cue == "relief_scale" and not self.log_limits[0] + 1e-9 < value < self.log_limits[1] - 1e-9:
            text += ", at its bound"
        wanted = range_text(self.ranges.get(cue, ()), words)
        return f"{text} (cars: {wanted})" if wanted else text

    def leading(self, parts: tuple[EvidencePart, ...], d: float, rose: bool) -> str:
        """What depth says, and the cues that make up most of what speaks for a candidate that rose, or
        against one that fell."""
        total = sum(p.log_odds for p in parts)
        own = [p for p in parts if (p.log_odds > 0) == rose]
        half, told, said = sum(p.log_odds for p in own) / 2, [], 0.0
        for part in own[:TOLD]:
            told.append(part.text)
            said += part.log_odds
            if abs(said) >= abs(half):
                break
        head = f"depth speaks {'for' if total > 0 else 'against'} a car (D {d:.2f})"
        if (total > 0) == rose:
            return f"{head}: {'; '.join(told)}"
        # it moved the other way than its own depth says: the depth of other candidates says more
        head += (
            ", but more so against others that it passed"
            if rose
            else ", but more so for others that passed it"
        )
        side = "for" if rose else "against"
        return f"{head}; {side} it: {'; '.join(told)}" if told else f"{head}; nothing speaks {side} it"

    def taken_for(self, cues: FloatArray) -> str:
        """What a candidate that fell is taken for, in mode "instance"; empty where nothing says it."""
        if self.mode != Registration.INSTANCE:
            return ""
        kind = look_alike(dict(zip(cue_names(), cues.tolist(), strict=True)))
        return f"; taken for {kind}" if kind else ""

    def without_evidence(self, why: str, detail: str, cues: FloatArray, rose: bool) -> str:
        """Why a candidate has no evidence, and what that means for its score."""
        if why == NOT_RESCORED:
            return "not rescored"
        told = status_text(why)
        measured = cues[cue_column("measured")]
        match why:
            case Reason.SECOND_BOX:
                return f"{told}{f' ({detail})' if detail else ''}: ranks below all boxes that stay"
            case Reason.NO_STEREO if self.mode == Registration.INSTANCE and measured > 0:
                # there is depth in the box, but nothing to place an instance by
                told, detail = "no car could be placed", "a car's distance is not known"
            case Reason.NO_STEREO if self.mode != Registration.PAPER:
                detail = f"{100 * (1 - measured):.0f} % of stereo missing"
            case Reason.STEREO_NOT_BELIEVED | Reason.VIEW_NOT_LEARNED | Reason.RELIEF_TOO_SMALL:
                detail = self._failed_checks(cues)
        # eq. 7 raises a likelihood below 1 - D, so that those with evidence pass those without
        keeps = "keeps its likelihood" + ("" if rose else "; others rose past it")
        left = keeps if self.mode == Registration.PAPER else "depth counts neither for nor against it"
        return f"{told}{f' ({detail})' if detail else ''}: {left}"

    def _failed_checks(self, cues: FloatArray) -> str:
        failed = []
        for name, floor in ({} if self.model is None else self.model.floors).items():
            value = float(cues[cue_column(name)])
            if value < floor:
                words = self.words[name]
                failed.append(f"{words.told(value)}, at least {words.value(floor)} needed")
        return "; ".join(failed)


def _functions(model: EvidenceModel) -> list[tuple[str, list[float], list[float]]]:
    """Name, knots and log odds of each cue's function."""
    return [(cue, at.tolist(), model.log_odds[cue].tolist()) for cue, at in model.knots.items()]
