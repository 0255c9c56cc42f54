"""Examination of the installation and of data sets."""

from rescore.doctor.data import examine_dataset
from rescore.doctor.installation import examine_installation

__all__ = ["examine_dataset", "examine_installation"]
