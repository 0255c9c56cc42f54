"""Who runs the frames: processes of this machine, Dask or Ray."""

from dataclasses import dataclass
from enum import StrEnum


class EngineName(StrEnum):
    """Engines that run frames."""

    JOBLIB = "joblib"
    """Processes of this machine, with nothing to install."""


@dataclass(frozen=True)
class Executor:
    """An engine and how many workers it has."""

    engine: EngineName = EngineName.JOBLIB
    jobs: int = 1
    """Workers where the engine is started here; one of joblib is this process itself."""


Workers = int | Executor
"""Who runs the frames; a number stands for so many processes of this machine."""


def executor_of(workers: Workers) -> Executor:
    """The executor that is meant."""
    return workers if isinstance(workers, Executor) else Executor(jobs=workers)
