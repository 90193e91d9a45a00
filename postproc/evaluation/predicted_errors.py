"""Predicted errors of a program in numbers, collected chunk by chunk."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np

from kinematics.transforms import Array
from postproc.compensation.significance import Significance
from postproc.text.line_numbers import ranges, shortened

AT_ENDS, BETWEEN_ENDS, UNCORRECTED = "at block ends", "between block ends", "where an axis is not corrected"
"""Places of errors."""


class Statistic(msgspec.Struct):
    """Largest size and RMS of a stream of numbers."""

    count: int = 0
    """Number of values."""
    square_sum: float = 0.0
    """Sum of their squares."""
    largest: float = 0.0
    """The largest value."""

    def add(self, values: Array) -> None:
        """Add values of any shape; signs do not matter."""
        self.count += values.size
        self.square_sum += float(np.sum(values * values))
        self.largest = max(self.largest, float(np.abs(values).max(initial=0.0)))

    @property
    def rms(self) -> float:
        """Root mean square; 0 without values."""
        return math.sqrt(self.square_sum / self.count) if self.count else 0.0

    def json(self) -> dict[str, float | int]:
        """The machine-readable form, rounded to 4 decimals: 0.1 nm for numbers in um."""
        return {"max": round(self.largest, 4), "rms": round(self.rms, 4), "count": self.count}


class UnsplitMoves(msgspec.Struct):
    """Moves that deviate by more than the tolerance between their ends, and could not be split."""

    lines: list[int] = msgspec.field(default_factory=list)
    largest_um: float = 0.0

    def add(self, line: int, size_um: float) -> None:
        """Add a move."""
        self.lines.append(line)
        self.largest_um = max(self.largest_um, size_um)

    def text(self, reason: str) -> str:
        """The note for the user."""
        lines = shortened(ranges(self.lines))
        return f"not split, deviates by up to {self.largest_um:.3g} um between its ends: {reason} (lines {lines})"

    def json(self, reason: str) -> dict[str, Any]:
        """The machine-readable form."""
        return {"reason": reason, "lines": ranges(self.lines), "strays_up_to_um": round(self.largest_um, 4)}


class LargestErrors(msgspec.Struct):
    """Largest errors before and after a correction, um, of all moves that cut and of all evaluated ends of moves.

    Moves with axes that are not corrected count too.
    """

    before: float = 0.0
    after: float = 0.0
    where: str = ""
    """Place of the largest error after the correction; empty without errors."""

    def add(self, where: str, before: Array, after: Array) -> None:
        """Add errors of any shapes, um, at places of one kind."""
        self.before = max(self.before, float(before.max(initial=0.0)))
        largest = float(after.max(initial=0.0))
        if largest > self.after or not self.where:
            self.after, self.where = max(largest, self.after), where if after.size else self.where

    def text(self) -> str:
        """Both errors for people."""
        return f"{self.before:.2f} -> {self.after:.2f} um ({self.where})"

    def json(self) -> dict[str, Any]:
        """The machine-readable form, rounded as that of a Statistic."""
        return {"before": round(self.before, 4), "after": round(self.after, 4), "place": self.where}


class PredictedErrors(msgspec.Struct):
    """Errors that the exact model predicts before and after a correction, um; of the tool axis, urad."""

    before: Statistic = msgspec.field(default_factory=Statistic)
    """Errors at the ends of moves before the correction, um."""
    after: Statistic = msgspec.field(default_factory=Statistic)
    """Errors at the ends of moves after the correction, um."""
    absolute_before: Statistic = msgspec.field(default_factory=Statistic)
    """Errors before correction from the nominal tool point, um, if the given work offsets are true."""
    absolute_after: Statistic = msgspec.field(default_factory=Statistic)
    """Errors after the correction, um."""
    tilt_before: Statistic = msgspec.field(default_factory=Statistic)
    """Errors of the tool axis, urad."""
    tilt_after: Statistic = msgspec.field(default_factory=Statistic)
    """Errors after the correction, urad."""
    between_ends: Statistic = msgspec.field(default_factory=Statistic)
    """Errors between the ends of feed moves after the correction, um."""
    anywhere: LargestErrors = msgspec.field(default_factory=LargestErrors)
    """Largest errors, at the ends of moves or between them, um."""
    uncertainty: Statistic = msgspec.field(default_factory=Statistic)
    """Standard uncertainties (k = 1) of the predicted errors, um."""
    significance: Significance = msgspec.field(default_factory=Significance)
    """Share of the improvement that exceeds its uncertainty."""
    not_split: dict[str, UnsplitMoves] = msgspec.field(default_factory=dict)
    """Moves in one segment that exceed the tolerance, by reason."""
