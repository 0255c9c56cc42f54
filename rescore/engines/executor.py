"""Who runs the frames: processes of this machine, Dask or Ray."""

from dataclasses import dataclass
from enum import StrEnum

from recon.errors import RescoreError


class EngineName(StrEnum):
    """Engines that run frames."""

    JOBLIB = "joblib"
    """Processes of this machine, with nothing to install."""
    DASK = "dask"
    """Workers of a Dask cluster."""
    RAY = "ray"
    """Workers of a Ray cluster."""


@dataclass(frozen=True)
class Executor:
    """An engine, and where its workers are."""

    engine: EngineName = EngineName.JOBLIB
    jobs: int = 1
    """Workers where the engine is started here; one of joblib is this process itself."""
    address: str | None = None
    """A cluster that runs; None starts one on this machine."""

    @staticmethod
    def of(engine: str, jobs: int, address: str | None) -> "Executor":
        """The executor that a user names.

        Raises:
            RescoreError: no such engine, or one that has no address.
        """
        if engine not in list(EngineName):
            known = ", ".join(EngineName)
            raise RescoreError(f"--engine: expected {known}, got {engine!r}; choose one of these")
        if address is not None and engine == EngineName.JOBLIB:
            raise RescoreError(
                "--address: expected --engine dask or ray with it, got joblib, which runs on this machine; "
                "name the engine"
            )
        return Executor(EngineName(engine), jobs, address)


Workers = int | Executor
"""Who runs the frames; a number stands for so many processes of this machine."""


def executor_of(workers: Workers) -> Executor:
    """The executor that is meant."""
    return workers if isinstance(workers, Executor) else Executor(jobs=workers)
