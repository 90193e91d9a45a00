"""A probing program before it is written: its moves and its touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array


@dataclass(frozen=True)
class ProbingSequence:
    """Moves of the program; mm and degrees."""

    machine: Machine
    positions: Array
    """End of each move `(m, axes)`; the first is the parking position."""
    touch: np.ndarray
    """Number of the touch `(m,)` in its row, from 1, where the move ends at the contact; 0 for other moves."""
    row: np.ndarray
    """Row of the plan `(m,)`, from 1."""
    rows: Sequence[str]
    """Name of each row: its point and sphere."""
    plan_id: int


SERVO_CYCLE_MS = 1.0
"""Usual servo cycle of controls, ms: that of LinuxCNC by default; others have 0.5 to 4 ms."""


@dataclass(frozen=True)
class ProbingSettings:
    """Feeds, mm/min (deg/min where only rotary axes move), and the work offset."""

    feed: float = 2000.0
    probing: float = 200.0
    measuring: float = 30.0
    back_mm: float = 1.0
    """Distance by which the tip goes back between both touches, mm."""
    offset: tuple[str, Mapping[str, float]] | None = None
    """Name of the work offset and its values by axis, mm and degrees; None for machine coordinates."""

    @property
    def contact_um(self) -> float:
        """Way of the tip in a servo cycle at the feed of the touch that counts, um: the control reads once in it."""
        return self.measuring / 60.0 * SERVO_CYCLE_MS


@dataclass(frozen=True)
class Touch:
    """A touch from its start to the end that it would reach without contact, as axis positions by name."""

    row: int
    number: int
    start: Mapping[str, float]
    end: Mapping[str, float]
    back: Mapping[str, float]
    """Way back between both touches by linear axis, mm: outwards along the normal of the sphere."""

    @property
    def path(self) -> dict[str, float]:
        """Way from start to end by linear axis, mm."""
        return {name: self.end[name] - self.start[name] for name in self.back}

    @property
    def length(self) -> float:
        """Distance from start to end, mm."""
        return float(np.linalg.norm(list(self.path.values())))


def joined(words: Mapping[str, float], signed: bool = False) -> str:
    """Words of axes with four decimals; `signed` also with a plus."""
    return " ".join(f"{name}{value + 0.0:{'+' if signed else ''}.4f}" for name, value in words.items())
