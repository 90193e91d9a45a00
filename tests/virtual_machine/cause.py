"""What every cause of error offers, and the answer that a diagnosis has to give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from virtual_machine.chain import Array
from virtual_machine.session import Session

UM, URAD, HOUR = 1e-3, 1e-6, 3600.0


@dataclass(frozen=True)
class Answer:
    """How a diagnosis (contract 4.3) names a cause."""

    kinds: tuple[str, ...]
    """Any of these."""
    axes: tuple[str, ...] = ()
    """Any of these; empty where the cause belongs to no axis."""
    fields: Mapping[str, object] = field(default_factory=dict)
    """What else has to be said: the component, the circle, the rows."""
    sizes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Parameters, by their keys."""
    either_sign: bool = False
    """True where the sign depends on which part is taken for the one that moved."""


@dataclass(frozen=True)
class Cause:
    """One physical cause; sizes in um and urad. By itself it does nothing."""

    LINEAR: ClassVar[tuple[str, ...]] = ()
    """Fields that its displacement is proportional to: numbers, or rows of numbers."""

    def errors(self, session: Session) -> Array:
        """Error motions `(n, axes, 6)` that it adds, mm and rad."""
        return np.zeros((*session.positions.shape, 6))

    def tool(self, session: Session) -> Array:
        """Displacement of the tool `(n, 6)` in its own directions, mm and rad."""
        return np.zeros((len(session), 6))

    def seen(self, session: Session, points: Array) -> Array:
        """Where the instrument sees points `(n, 3)` of its own frame, mm; it stands in the origin."""
        del session
        return points

    def answer(self) -> Answer:
        """What a diagnosis has to say of it."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Self:
        """The cause, so many times as large."""
        changes = {}
        for name in self.LINEAR:
            value = getattr(self, name)
            changes[name] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        return replace(self, **changes)


def of_axis(session: Session, axis: str, component: int, values: Array) -> Array:
    """Error motions `(n, axes, 6)`, one of which is not zero."""
    result = np.zeros((*session.positions.shape, 6))
    result[:, session.chain.index(axis), component] = values
    return result


def micro(letter: str) -> float:
    """mm per um, or rad per urad, of a direction or an axis."""
    return URAD if letter[0] in "ABC" else UM


def unit(letter: str) -> str:
    """um, or urad, of a direction or an axis."""
    return "urad" if letter[0] in "ABC" else "um"
