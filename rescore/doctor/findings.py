"""What an examination finds: a line each."""

from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARNING = "warning"
    """Doubtful, or a matter of taste: work can go on."""
    ERROR = "error"
    """Results would be wrong, or there would be none."""


@dataclass(frozen=True)
class Finding:
    """One finding."""

    level: Level
    where: str
    what: str
    advice: str = ""

    def __str__(self) -> str:
        text = f"{self.level:<8}{self.where}: {self.what}"
        # what comes from a file or a library may have lines of its own
        return " ".join((f"{text}; {self.advice}" if self.advice else text).splitlines())


def graded(value: float, warning: float, error: float) -> Level:
    """The level of a value that should be small."""
    return Level.ERROR if value > error else Level.WARNING if value > warning else Level.OK
