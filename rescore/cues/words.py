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

    def span(self, low: float, high: float) -> str:
        """Two values as a range, with the unit once."""
        return f"{self.value(low).partition(' ')[0]} to {self.value(high)}"

    def at_least(self, low: float) -> str:
        """The values from one on."""
        return f"{self.value(low)} or more"

    def at_most(self, high: float) -> str:
        """The values up to one."""
        return f"{self.value(high)} or less"


@dataclass(frozen=True)
class Side:
    """How a cue that can point two ways is told where it points one way."""

    sentence: str
    """With one place for the amount, which has no sign."""
    short: str
    """The unit and the way in a range, after the number."""


@dataclass(frozen=True)
class TwoWayWords(CueWords):
    """How a cue is told that can point two ways; ``sentence`` is told where it points neither way."""

    below: Side
    """How a negative value is told."""
    beyond: Side
    """How a positive value is told."""
    least: float
    """An amount, as told, below this points neither way."""
    most: float = np.inf
    """An amount, as told, that may have been cut off here."""

    def value(self, stored: float) -> str:
        """The amount with its way, or the amount alone where it points neither way."""
        side = self._side(stored)
        number = self._amount(stored)
        return number if side is None else f"{number.partition(' ')[0]} {side.short}"

    def told(self, stored: float) -> str:
        """The sentence of the way that the value points, with its amount."""
        side, amount = self._side(stored), self._amount(stored)
        cut_off = abs(self.shown(stored)) >= self.most
        return self.sentence if side is None else side.sentence.format(f"{'at least ' * cut_off}{amount}")

    def span(self, low: float, high: float) -> str:
        """Two values as a range, the way once where it is the same."""
        one, other = self._side(low), self._side(high)
        if one is not other or one is None:
            return f"{self.value(low)} to {self.value(high)}"
        # the smaller amount first
        first, last = sorted((low, high), key=abs)
        return f"{self._amount(first).partition(' ')[0]} to {self.value(last)}"

    def at_least(self, low: float) -> str:
        """The values from one on, in amounts of its way."""
        return f"at most {self.value(low)}" if self._below(low) else super().at_least(low)

    def at_most(self, high: float) -> str:
        """The values up to one, in amounts of its way."""
        return f"at least {self.value(high)}" if self._below(high) else super().at_most(high)

    def _below(self, stored: float) -> bool:
        return self._side(stored) is self.below

    def _side(self, stored: float) -> Side | None:
        if abs(self.shown(stored)) < self.least:
            return None
        return self.below if stored < 0 else self.beyond

    def _amount(self, stored: float) -> str:
        return self.form.format(abs(self.shown(stored)))


def share(sentence: str, form: str = "{:.0f} %") -> CueWords:
    """Words of a cue that is a share in [0, 1]."""
    return CueWords(sentence, lambda v: 100 * v, form)


def times(sentence: str, form: str = "{:.1f} times") -> CueWords:
    """Words of a cue that is the logarithm of a factor."""
    return CueWords(sentence, lambda v: float(np.exp(v)), form)


def metres(sentence: str, form: str = "{:.1f} m") -> CueWords:
    """Words of a cue in metres."""
    return CueWords(sentence, float, form)


def ends(side: str, most: float) -> CueWords:
    """Words of where the car that depth shows ends, in widths or heights of the box.

    Args:
        side: "left", "right", "upper" or "lower".
        most: extents at which the cue is cut off, both ways.
    """
    car = "the car depth shows"
    return TwoWayWords(
        f"{car} ends at the box's {side} edge",
        lambda v: 100 * v,
        "{:.0f} %",
        Side(f"{car} ends {{}} inside the box's {side} edge", "% inside"),
        Side(f"{car} goes {{}} past the box's {side} edge", "% past"),
        least=3,
        most=100 * most - 0.5,
    )


def signed_share(neither: str, below: Side, beyond: Side) -> CueWords:
    """Words of a difference of two log likelihoods as a share of the most that it can be.

    Args:
        neither: sentence where the difference is small.
        below: where it is negative.
        beyond: where it is positive.
    """
    return TwoWayWords(neither, lambda v: 100 * v, "{:.0f} %", below, beyond, least=3)


def signed_nats(neither: str, below: Side, beyond: Side) -> CueWords:
    """Words of a difference of two log likelihoods, kept as the signed log(1 + nats).

    Args:
        neither: sentence where the difference is small.
        below: where it is negative.
        beyond: where it is positive.
    """
    return TwoWayWords(
        neither, lambda v: float(np.sign(v) * np.expm1(abs(v))), "{:.0f} nats", below, beyond, least=1
    )
