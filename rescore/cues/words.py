"""How a cue is told in words, with its value."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class CueWords:
    """How a cue is told."""

    sentence: str
    """With one place for the value."""
    shown: Callable[[float], float]
    """From the stored value to the one told; rising."""
    form: str
    """Format of the value told, with its unit."""

    def value(self, stored: float) -> str:
        """The value alone."""
        return self.form.format(self.shown(stored)).replace("-0.0 ", "0.0 ")

    def told(self, stored: float) -> str:
        """The sentence with its value."""
        return self.sentence.format(self.value(stored))


def share(sentence: str, form: str = "{:.0f} %") -> CueWords:
    """Words of a cue that is a share in [0, 1]."""
    return CueWords(sentence, lambda v: 100 * v, form)


def times(sentence: str, form: str = "{:.1f} times") -> CueWords:
    """Words of a cue that is the logarithm of a factor."""
    return CueWords(sentence, lambda v: float(np.exp(v)), form)


def metres(sentence: str, form: str = "{:.1f} m") -> CueWords:
    """Words of a cue in metres."""
    return CueWords(sentence, float, form)


def extents(sentence: str, form: str = "{:+.0f} % of it") -> CueWords:
    """Words of a cue in extents of the box, negative the other way."""
    return CueWords(sentence, lambda v: 100 * v, form)


def nats(sentence: str, form: str = "{:.1f}") -> CueWords:
    """Words of a cue that is a log likelihood, or its signed log(1 + nats)."""
    return CueWords(sentence, float, form)
