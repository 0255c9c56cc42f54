"""The splits of a data set and its parts for fitting, as types that refuse to share images or car shapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from recon.errors import RescoreError
from rescore.data.frames import SPLITS, DataSet


@dataclass(frozen=True, eq=False)
class Splits:
    """Disjoint parts of one data set; built only where nothing leaks from one to another."""

    train: DataSet
    calibration: DataSet
    validation: DataSet
    test: DataSet

    def __post_init__(self) -> None:
        parts = {name: getattr(self, name) for name in SPLITS}
        _refuse_overlap("image", {k: {f.left_path for f in v.frames} for k, v in parts.items()})
        shapes = {k: {s for t in v.truth.values() for s in t.shape_id if s} for k, v in parts.items()}
        _refuse_overlap("car shape", shapes)

    @staticmethod
    def of(data: DataSet) -> "Splits":
        """The four splits of a data set."""
        return Splits(*(data.split(name) for name in SPLITS))

    @property
    def validation_set(self) -> "ValidationSet":
        """The only thing that a weight can be tuned on."""
        return ValidationSet(self.validation, _from_splits=_KEY)

    @property
    def fitting_set(self) -> "FittingSet":
        """The only thing that a model of depth evidence can be fitted to."""
        data = self.train
        return FittingSet(
            replace(
                data,
                frames=(*self.train.frames, *self.calibration.frames),
                truth={**self.train.truth, **self.calibration.truth},
            ),
            _from_splits=_KEY,
        )


_KEY = object()


@dataclass(frozen=True, eq=False)
class ValidationSet:
    """Validation frames of a data set whose splits share nothing; made by ``Splits.validation_set`` alone.

    What is tuned takes this type, so that test frames cannot get there by mistake.
    """

    data: DataSet
    _from_splits: object

    def __post_init__(self) -> None:
        if self._from_splits is not _KEY:
            raise TypeError("a ValidationSet comes from Splits.of(data).validation_set, nowhere else")
        strangers = sorted({f.split for f in self.data.frames} - {"validation"})
        if strangers:
            raise RescoreError(
                f"validation set: expected split 'validation' alone, got {strangers[0]!r} too; mend it"
            )


@dataclass(frozen=True, eq=False)
class FittingSet:
    """Training and calibration frames of such a data set; made by ``Splits.fitting_set`` alone.

    Detectors never look at measured depth, so the frames that trained them serve too.
    """

    data: DataSet
    _from_splits: object

    def __post_init__(self) -> None:
        if self._from_splits is not _KEY:
            raise TypeError("a FittingSet comes from Splits.of(data).fitting_set, nowhere else")
        strangers = sorted({f.split for f in self.data.frames} - {"train", "calibration"})
        if strangers:
            raise RescoreError(
                f"fitting set: expected splits 'train' and 'calibration' alone, got {strangers[0]!r} too; "
                "mend it"
            )


def _refuse_overlap(what: str, members: Mapping[str, set[Path] | set[str]]) -> None:
    names: Sequence[str] = tuple(members)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            shared = sorted(str(x) for x in members[a] & members[b])
            if shared:
                raise RescoreError(
                    f"splits: {a} and {b} must share no {what}, both hold {shared[0]!r} "
                    f"({len(shared)} in all); give each to one split"
                )
