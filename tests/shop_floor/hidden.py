"""What every hidden effect offers, and the answers that a diagnosis may give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from shop_floor.chain import COMPONENTS, Array, no_errors
from shop_floor.designs import Run
from shop_floor.error_motions import PER_MICRO


@dataclass(frozen=True)
class Answer:
    """The right names of an effect in a diagnosis (contract 4.3); kinds are empty for an effect that has no name."""

    kinds: tuple[str, ...] = ()
    where: frozenset[str] = frozenset()
    """Axes, directions or circles that may be given; any where it is empty."""
    also: frozenset[str] = frozenset()
    """Further axes or directions in which the effect is present, too small to be required."""
    component: str = ""
    """Direction of the error motion; any where it is empty."""
    relatives: tuple[str, ...] = ()
    """Kinds of the same physical cause, or of a part of it: neither right nor false."""
    sizes: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    """Parameters by their keys; `P2 AXIS` for a coefficient of a cross-axis error."""
    either_sign: bool = False
    """True where the sign of the sizes depends on which part is taken for the one that moved."""
    harmonic: int | None = None
    """Harmonic for which the sizes hold."""
    variables: frozenset[str] = frozenset()
    """Variables that the unexplained residual of an effect without a name depends on; any where it is empty."""
    rows: frozenset[int] = frozenset()
    """Rows of the measurement, counted from 0."""


@dataclass(frozen=True)
class Hidden:
    """An effect of a size in um, urad or K; by itself it does nothing. Displacements are proportional to the size."""

    LARGEST: ClassVar[float] = 250.0
    """Largest size that occurs in a shop."""
    size: float = 1.0

    def on_run(self, run: Run) -> Run:
        """The run as it is logged with the effect."""
        return run

    def errors(self, run: Run) -> Array:
        """Errors `(n, axes, 6)` that it adds, mm and rad."""
        return no_errors(run.positions)

    def tool(self, run: Run) -> Array:
        """Displacement `(n, 3)` of the tool in its own directions, mm."""
        return np.zeros((len(run), 3))

    def reading(self, run: Run, points: Array) -> Array:
        """Readings for points `(n, 3)` of the tracker's frame, mm."""
        del run
        return points

    def answer(self, run: Run) -> Answer:
        """The right answer."""
        raise NotImplementedError

    def sized(self, size: float) -> Self:
        """The effect with another size."""
        return replace(self, size=size)


def of_axis(run: Run, axis: str, component: str, values: Array) -> Array:
    """Errors `(n, axes, 6)`, one of which is not zero: values in um or urad."""
    errors = no_errors(run.positions)
    k = COMPONENTS.index(component)
    errors[:, run.machine.column(axis), k] = values * PER_MICRO[k]
    return errors
