"""Causes in the instrument: in its own frame, beams from the origin, azimuth about z from x. Observed is what it says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from virtual_machine.cause import HOUR, UM, URAD, Answer, Cause
from virtual_machine.chain import Array, rotations
from virtual_machine.session import Session


@dataclass(frozen=True)
class StationShift(Cause):
    """Somebody bumps the stand: from some row on one station has moved, and turned about its origin."""

    LINEAR: ClassVar[tuple[str, ...]] = ("shift", "turn")
    station: str
    from_row: int
    shift: tuple[float, ...]
    turn: tuple[float, ...]

    def seen(self, session: Session, points: Array) -> Array:
        """The instrument moves, so all it sees moves the other way."""
        after = (session.stations == self.station) & (np.arange(len(session)) >= self.from_row)
        weight = after.astype(float)[:, None]
        return _from_moved(points, weight * np.array(self.shift) * UM, weight * np.array(self.turn) * URAD)

    def answer(self) -> Answer:
        """Named with its station; whether the part before or after has moved is a matter of view."""
        sizes = {"shift_um": self.shift, "turn_urad": self.turn}
        return Answer(("station-shift",), (), {"station": self.station}, sizes, either_sign=True)


@dataclass(frozen=True)
class TrackerDrift(Cause):
    """The stand creeps: the tracker moves, and turns about its origin, at constant rates."""

    LINEAR: ClassVar[tuple[str, ...]] = ("shift", "turn")
    shift: tuple[float, ...]
    """um per hour."""
    turn: tuple[float, ...] = (0.0, 0.0, 0.0)
    """urad per hour."""

    def seen(self, session: Session, points: Array) -> Array:
        """The instrument moves, so all it sees moves the other way."""
        hours = session.clock[:, None] / HOUR
        return _from_moved(points, hours * np.array(self.shift) * UM, hours * np.array(self.turn) * URAD)

    def answer(self) -> Answer:
        """Named with its rates."""
        return Answer(("tracker-drift",), (), sizes={"shift_um_per_h": self.shift, "turn_urad_per_h": self.turn})


@dataclass(frozen=True)
class RangeOffset(Cause):
    """A zero of the distance meter that is off: every range is read too long by the same."""

    LINEAR: ClassVar[tuple[str, ...]] = ("offset",)
    offset: float = 1.0

    def seen(self, session: Session, points: Array) -> Array:  # noqa: ARG002
        """Along the beam."""
        azimuth, elevation, length = _polar(points)
        return _cartesian(azimuth, elevation, length + self.offset * UM)

    def answer(self) -> Answer:
        """Named with its offset."""
        return Answer(("tracker-range",), (), sizes={"offset_um": (self.offset,)})


@dataclass(frozen=True)
class AirScale(Cause):
    """A refractive index that is off: every range is read too long in proportion."""

    LINEAR: ClassVar[tuple[str, ...]] = ("scale",)
    scale: float = 1.0

    def seen(self, session: Session, points: Array) -> Array:  # noqa: ARG002
        """Along the beam."""
        azimuth, elevation, length = _polar(points)
        return _cartesian(azimuth, elevation, length * (1.0 + self.scale * 1e-6))

    def answer(self) -> Answer:
        """Named with its scale."""
        return Answer(("air-scale",), (), sizes={"scale_um_per_m": (self.scale,)})


@dataclass(frozen=True)
class AngleHarmonic(Cause):
    """An encoder whose disc is off centre (one wave a turn) or elliptic (two)."""

    LINEAR: ClassVar[tuple[str, ...]] = ("sine", "cosine")
    circle: str
    harmonic: int
    sine: float
    cosine: float

    def seen(self, session: Session, points: Array) -> Array:  # noqa: ARG002
        """The circle reads too much by both waves."""
        azimuth, elevation, length = _polar(points)
        angle = self.harmonic * (azimuth if self.circle == "azimuth" else elevation)
        too_much = (self.sine * np.sin(angle) + self.cosine * np.cos(angle)) * URAD
        if self.circle == "azimuth":
            return _cartesian(azimuth + too_much, elevation, length)
        return _cartesian(azimuth, elevation + too_much, length)

    def answer(self) -> Answer:
        """Named with its circle."""
        sizes = {"sine_urad": (self.sine,), "cosine_urad": (self.cosine,)}
        return Answer(("tracker-angle",), (), {"circle": self.circle}, sizes)


@dataclass(frozen=True)
class Outliers(Cause):
    """Single rows that went wrong: a beam broken and caught again, a reflector not seated."""

    LINEAR: ClassVar[tuple[str, ...]] = ("shifts",)
    numbers: tuple[int, ...]
    shifts: tuple[float, ...]
    """um: x y z of each row."""

    def seen(self, session: Session, points: Array) -> Array:  # noqa: ARG002
        """Each of them elsewhere."""
        result = points.copy()
        result[list(self.numbers)] += np.array(self.shifts).reshape(-1, 3) * UM
        return result

    def answer(self) -> Answer:
        """Named by their rows, counted from 0."""
        return Answer(("outliers",), (), {"rows": self.numbers})


def _from_moved(points: Array, shift: Array, turn: Array) -> Array:
    """Points `(n, 3)` as seen by an instrument that is shifted and turned about its origin, mm and rad `(n, 3)`."""
    return np.asarray((np.swapaxes(rotations(turn), 1, 2) @ (points - shift)[:, :, None])[:, :, 0])


def _polar(points: Array) -> tuple[Array, Array, Array]:
    """Azimuth, elevation and length `(n,)`."""
    x, y, z = points.T
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.sqrt(x * x + y * y + z * z)


def _cartesian(azimuth: Array, elevation: Array, length: Array) -> Array:
    flat = length * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), length * np.sin(elevation)], axis=1)
