"""The view of each candidate: from its detector, from the fit, from the class model, or one for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from recon.arrays import FloatArray, IntArray, UInt8Array
from recon.camera import GroundedCamera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.localization.disparity_fit import BoxFit
from recon.reconstruction.reconstruct import ReconstructConfig, Reconstruction, RegisteredOutline, reconstruct
from recon.reconstruction.view_selection import ViewSelectionConfig, likely_views
from recon.view_bins import ViewBins
from rescore.evidence.candidates import Candidates

UNSEEN = 3
"""View bin of candidates where neither a detector nor a fit says one: the left side, as in the report."""
NO_BIN = -1
"""View bin of a candidate that cannot be reconstructed from any."""

TEMPER = 0.04
"""Weight of what poses of the fit weigh, in nats, in the probability of a view. The fit takes samples to be
independent whose errors are alike all over a car, so its nats are too many. The weight is the one with which
the bins of annotated cars are likeliest, on the frames of preset ``streets`` that train and validate."""


@dataclass(frozen=True, eq=False)
class FittedViews:
    """What the fit says of the side from which each candidate is seen."""

    view_bin: IntArray
    """The likeliest bin, shape (n,); ``NO_BIN`` where nothing was fitted."""
    probability: FloatArray
    """Probability of that bin, shape (n,); NaN where nothing was fitted."""
    second_bin: IntArray
    """The next bin, shape (n,); ``NO_BIN`` where nothing was fitted."""

    def columns(self, bins: ViewBins) -> dict[str, Any]:
        """The columns of ``CandidateTable``, the bins by their names."""
        names = np.array([*(bins.name(b) for b in range(bins.count)), ""], object)
        return {
            "view_bin": names[self.view_bin],
            "view_probability": self.probability,
            "second_view": names[self.second_bin],
        }


def views_of_fits(fits: Sequence[BoxFit | None], bins: ViewBins, temper: float = TEMPER) -> FittedViews:
    """The likeliest bins of the instances that boxes frame, by all poses that the fit tried.

    The framed instance is one of them and mostly outweighs the others; its bin is then the likeliest.
    """
    from scipy.special import softmax  # noqa: PLC0415 (a third of a second)

    n = len(fits)
    first, second, probability = np.full(n, NO_BIN), np.full(n, NO_BIN), np.full(n, np.nan)
    fitted = {i: fit for i, fit in enumerate(fits) if fit is not None}
    if fitted:
        rows = list(fitted)
        weight = temper * _log_mass(list(fitted.values()), bins)
        first[rows], second[rows] = np.argsort(-weight, axis=1, kind="stable")[:, :2].T
        probability[rows] = softmax(weight, axis=1).max(axis=1)
    return FittedViews(first, probability, second)


def _log_mass(fits: Sequence[BoxFit], bins: ViewBins) -> FloatArray:
    """Logarithm of what the poses in each bin weigh, shape (n, count), nats up to a constant."""
    from scipy.special import logsumexp  # noqa: PLC0415 (a third of a second)

    of_headings = np.stack([fit.heading_log_mass for fit in fits])
    width = 2 * np.pi / of_headings.shape[1]
    shares = bins.shares(1.5 * np.pi - width * np.arange(of_headings.shape[1]), width)
    mass = logsumexp(of_headings[:, :, None], axis=1, b=shares)
    row = np.arange(len(fits))
    framed = [bins.containing(float(fit.framed.pose.azimuth_rad[0])) for fit in fits]
    mass[row, framed] = np.logaddexp(mass[row, framed], [fit.framed_log_mass for fit in fits])
    return np.asarray(mass)


@dataclass(frozen=True, eq=False)
class Views:
    """Views that the candidates of one frame are taken to be seen from."""

    view_bin: IntArray
    """The bin that each is reconstructed with, shape (n,); ``NO_BIN`` where none will do."""
    azimuth_rad: FloatArray
    """Azimuth of the view, shape (n,): the detector's where it says one, else the middle of the bin; NaN
    where neither is."""
    failures: Mapping[int, Failure]
    """Why each candidate of ``NO_BIN`` has no bin, by its place."""
    registered: Mapping[int, RegisteredOutline] = field(default_factory=dict)
    """Outlines with their parts that the choice of a bin has found already, by the candidate's place."""


def views_of(
    rgb: UInt8Array,
    candidates: Candidates,
    view_bin: int | Literal["fit", "model"],
    model: ClassModel,
    config: ReconstructConfig,
    fitted: FittedViews | None = None,
) -> Views:
    """The view of each candidate: the detector's azimuth where it gives one, else ``view_bin``.

    Args:
        rgb: the picture, shape (h, w, 3); looked at for "model" alone.
        candidates: the boxes.
        view_bin: of candidates without azimuth: one bin for all; "fit" for the bin of the fitted instance, or
            ``UNSEEN`` where there is none; or "model" for the bin that the class model explains each best
            with (``recon.reconstruction.view_selection.likely_views``).
        model: the class model.
        config: settings of the reconstruction.
        fitted: what the fit says of each candidate; None where nothing was fitted.

    Raises:
        RescoreError: the model has no such bin.
    """
    said, have = _said(candidates), {v.view_bin for v in model.views}
    bins, failures = _bins_without_detector(len(candidates), view_bin, fitted), dict[int, Failure]()
    registered = dict[int, RegisteredOutline]()
    if isinstance(view_bin, int):
        model.bins.check(view_bin)
    if view_bin == "model":
        rows = np.flatnonzero(np.isnan(said))
        selection = ViewSelectionConfig(reconstruct=config)
        for i, choice in zip(
            rows.tolist(), likely_views(rgb, candidates.xyxy_px[rows], model, selection), strict=True
        ):
            if isinstance(choice, Failure):
                failures[i] = choice
                continue
            bins[i] = choice.view_bin
            if choice.registered is not None:
                registered[i] = choice.registered
    azimuth_rad = np.where(np.isnan(said), _middle_rad(bins, model.bins), said)
    for i in range(len(candidates)):
        if np.isfinite(said[i]):
            bins[i] = model.bins.containing(float(said[i]))
        chosen = np.isfinite(said[i]) or view_bin == "fit"
        if chosen and int(bins[i]) not in have:
            failures[i] = _no_view(model, int(bins[i]), float(np.rad2deg(azimuth_rad[i])))
    bins[list(failures)] = NO_BIN
    return Views(bins, azimuth_rad, failures, registered)


def _said(candidates: Candidates) -> FloatArray:
    """Azimuth that the detector says of each candidate, shape (n,), radians; NaN where it says none."""
    if candidates.azimuth_deg is None:
        return np.full(len(candidates), np.nan)
    return np.asarray(np.deg2rad(candidates.azimuth_deg))


def _bins_without_detector(
    n: int, view_bin: int | Literal["fit", "model"], fitted: FittedViews | None
) -> IntArray:
    """The bin of each candidate (n,) where the detector says none; ``NO_BIN`` for "model"."""
    if view_bin == "model":
        return np.full(n, NO_BIN, np.int64)
    if view_bin != "fit":
        return np.full(n, view_bin, np.int64)
    found = np.full(n, NO_BIN, np.int64) if fitted is None else fitted.view_bin
    return np.where(found == NO_BIN, UNSEEN, found)


def _middle_rad(bins: IntArray, of: ViewBins) -> FloatArray:
    """Azimuth of the middle of each bin, shape (n,); NaN for ``NO_BIN``."""
    return np.where(bins == NO_BIN, np.nan, 2 * np.pi * bins / of.count)


def views_without_model(candidates: Candidates, view_bin: int | Literal["fit", "model"]) -> Views:
    """The view of each candidate where no class model is used: no bins, and the azimuths of ``views_of``.

    Args:
        candidates: the boxes.
        view_bin: as there; nothing is fitted for "fit", and nothing chooses for "model", which leaves
            azimuths unknown.

    Raises:
        RescoreError: no such bin.
    """
    n, said = len(candidates), _said(candidates)
    if isinstance(view_bin, int):
        ViewBins().check(view_bin)
    assumed = _middle_rad(_bins_without_detector(n, view_bin, None), ViewBins())
    return Views(np.full(n, NO_BIN, np.int64), np.where(np.isnan(said), assumed, said), {})


def reconstruct_views(
    rgb: UInt8Array,
    xyxy_px: FloatArray,
    views: Views,
    model: ClassModel,
    seen_from: GroundedCamera,
    config: ReconstructConfig,
) -> tuple[Reconstruction | Failure, ...]:
    """The 3D instance in each box (n, 4), or why there is none; all are done together."""
    found: dict[int, Reconstruction | Failure] = dict(views.failures)
    rows = np.flatnonzero(views.view_bin != NO_BIN)
    known = {k: views.registered[i] for k, i in enumerate(rows.tolist()) if i in views.registered}
    together = reconstruct(rgb, xyxy_px[rows], views.view_bin[rows], model, seen_from, config, known)
    found |= dict(zip(rows.tolist(), together, strict=True))
    return tuple(found[i] for i in range(len(xyxy_px)))


def _no_view(model: ClassModel, view_bin: int, azimuth_deg: float) -> Failure:
    have = ", ".join(str(v.view_bin) for v in model.views)
    return Failure(
        Reason.REGISTRATION_FAILED,
        f"a labelled view of bin {view_bin} expected for azimuth {azimuth_deg:.0f} degrees, "
        f"the class model has bins {have or 'none'}",
    )
