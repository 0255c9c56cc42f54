"""What ``make bench`` measured, as one file: machine, versions, a row a figure, and how times grow."""

import os
import platform
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter

from recon.reading import json_of, reading
from rescore.files import versions, write_json

_REMEDY = "call `make bench` again"


@dataclass(frozen=True)
class Machine:
    """What the times were measured on."""

    processor: str
    n_cores: int
    memory_gb: float
    system: str

    @staticmethod
    def this() -> "Machine":
        """The machine that this process runs on; its processor by the name that Linux tells."""
        told = Path("/proc/cpuinfo")
        lines = told.read_text(encoding="utf-8").splitlines() if told.is_file() else []
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        return Machine(
            processor=names[0] if names else platform.machine(),
            n_cores=len(os.sched_getaffinity(0)),
            memory_gb=round(pages / 2**30, 1),
            system=f"{platform.system()} {platform.machine()}",
        )


@dataclass(frozen=True)
class Row:
    """One figure with what it is wanted to be."""

    what: str
    value: float
    unit: str
    """Unit of ``value`` and ``wanted``: "ratio", "s", "ms" or "frames/s"."""
    wanted: float
    at_least: bool = False
    """Whether ``value`` is to be at least ``wanted``; else at most."""
    ours_ms: float | None = None
    """Time of the work and of what it is compared with, where the value is a ratio of times."""
    bare_ms: float | None = None
    clock: Literal["processor", "wall", "memory"] = "processor"
    """Processor time of one core, which a busy machine changes little, wall time, or peak memory."""

    @property
    def holds(self) -> bool:
        """Whether the figure is as wanted."""
        return self.value >= self.wanted if self.at_least else self.value <= self.wanted


@dataclass(frozen=True)
class Growth:
    """How the time of one kind of work grows with one size."""

    name: str
    """What is done, as a line of a chart is called."""
    along: str
    """The size that grows, as an axis is called; growths along the same size share a chart."""
    size: tuple[float, ...]
    seconds: tuple[float, ...]
    note: str = ""
    """Why it does not grow in proportion, where it does not."""


@dataclass(frozen=True)
class Bench:
    """The content of bench.json."""

    command: str
    machine: Machine
    versions: dict[str, str]
    rows: tuple[Row, ...]
    growth: tuple[Growth, ...] = ()
    failed: dict[str, str] = field(default_factory=dict)
    """Errors of the groups of figures that could not be measured, by name."""


_ADAPTER = TypeAdapter(Bench)


def bench_of_this_machine(
    command: str, rows: tuple[Row, ...], growth: tuple[Growth, ...], failed: dict[str, str]
) -> Bench:
    """The figures with machine and versions of this process."""
    return Bench(command, Machine.this(), versions(), rows, growth, failed)


def write_bench(path: Path, bench: Bench) -> None:
    """Write bench.json."""
    write_json(path, asdict(bench))


def read_bench(path: Path) -> Bench:
    """What ``write_bench`` wrote.

    Raises:
        RescoreError: no such file or another content.
    """
    value = json_of(path, "figures of `make bench`", _REMEDY)
    with reading(path, "figures of `make bench`", _REMEDY):
        return _ADAPTER.validate_python(value)
