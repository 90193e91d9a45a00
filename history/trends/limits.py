"""Alarm limits in the unit of the user, when a quantity will leave them, and the measurement that decides it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from history.trends.forecast import Forecast
from history.trends.model import Structure
from history.trends.series import Series, day_of
from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError

LIMIT = re.compile(
    r"\s*(?P<name>[^=]*[^=\s])\s*=\s*(?P<value>\d*\.?\d+)\s*(?P<unit>mm\s*/\s*(?P<length>\d*\.?\d+)\s*mm|mm|um/m|urad|um)\s*"
)
"""A limit: squareness X-Y=0.02mm/300mm."""
ANGLES = ("um/m", "urad")
MAY_HAVE_LEFT, HAS_LEFT = 0.05, 0.95
"""Probabilities of being outside from which a quantity may have left its limits, and has."""
SIGMA_OF_95 = 1.959964
"""Standard deviations on each side that hold 95 %."""
POWER = 0.8
"""Probability of a decision with which a measurement is worth its time: the usual power of a test (Cohen 1988)."""


def limits_of(
    texts: Sequence[str], units: Mapping[str, str], where: str = "--limit", owner: str = "the history"
) -> dict[str, float]:
    """Limits by quantity, in the units of the quantities; UserError for another text or a quantity without results.

    where: the option or entry that states them; owner: of the results.
    """
    found: dict[str, float] = {}
    for text in texts:
        match = LIMIT.fullmatch(text)
        if match is None or float(match["value"]) <= 0.0:
            raise UserError(
                f'{where} {text}: expected NAME=VALUE UNIT above 0, as in "squareness X-Y=0.02mm/300mm" or '
                '"backlash X=0.01mm"; units are mm, um, um/m, urad, and mm/300mm for an angle'
            )
        name = match["name"]
        if name not in units:
            known = ", ".join(units) or "none"
            raise UserError(f"{where} {text}: {owner} has no results of {name!r}{did_you_mean(name, units)}: {known}")
        found[name] = _value(f"{where} {text}", match, units[name])
    return found


def _value(text: str, match: re.Match[str], unit: str) -> float:
    """A limit in the unit of its quantity."""
    value, length = float(match["value"]), match["length"]
    if unit in ANGLES:
        if length is not None and float(length) > 0.0:
            return 1e6 * value / float(length)
        if match["unit"] in ANGLES:
            return value
        raise UserError(f"{text}: {match['name']} is an angle: state the length of the part, as in 0.02mm/300mm")
    if length is None and match["unit"] not in ANGLES:
        return value * (1e3 if match["unit"] == "mm" else 1.0)
    raise UserError(f"{text}: {match['name']} is a length, in {unit}: write its limit in mm or um")


class Deciding(NamedTuple):
    """A method of the history, and what its next result would decide."""

    method: str
    U: float
    """Its latest expanded uncertainty."""
    probability: float
    """Probability that the quantity is then known to be inside or outside."""


@dataclass(frozen=True)
class Leaving:
    """When a quantity leaves its limit."""

    limit: float
    """In the unit of the quantity."""
    outside: float
    """Probability that it is outside at the begin of the forecast."""
    first: float | None
    """From then on it may be outside (5 %); None: not within the forecast. Years since 1970."""
    last: float | None
    """From then on it is outside (95 %); None: not within the forecast."""
    methods: tuple[Deciding, ...]
    """What would decide it at that time, the least exact method first; empty without one."""

    @property
    def chosen(self) -> Deciding | None:
        """The least exact method that decides it, or the one that decides it most likely."""
        able = [each for each in self.methods if each.probability >= POWER]
        return able[0] if able else max(self.methods, key=lambda each: each.probability, default=None)

    def json(self) -> dict[str, Any]:
        """For programs."""
        dates = {"first": self.first, "last": self.last}
        return {
            "limit": self.limit, "probability_outside": self.outside,
            **{name: None if time is None else day_of(time).isoformat() for name, time in dates.items()},
            "measurements": [each._asdict() for each in self.methods],
        }  # fmt: skip


def leaving(structure: Structure, ahead: Forecast, limit: float) -> Leaving:
    """When the quantity leaves its limit, by its forecast."""
    outside = ahead.outside(limit)
    first = next((k for k, p in enumerate(outside.tolist()) if p >= MAY_HAVE_LEFT), None)
    last = next((float(t) for t, p in zip(ahead.times, outside.tolist(), strict=True) if p >= HAS_LEFT), None)
    methods = () if first is None or last == ahead.times[first] else _deciding(structure, ahead, first, limit)
    return Leaving(limit, float(outside[0]), None if first is None else float(ahead.times[first]), last, methods)


def _deciding(structure: Structure, ahead: Forecast, k: int, limit: float) -> tuple[Deciding, ...]:
    """What one result of each method would decide at a time of the forecast, the least exact first.

    It decides if its band of 95 % is wholly inside or outside of the limit.
    """
    scatter = structure.scatter
    mean, variance = float(ahead.mean[k]), float(ahead.u[k]) ** 2
    found = []
    for name, u in latest_u(structure.series).items():
        after = variance * (u**2 + scatter) / (variance + u**2 + scatter)
        margin, spread = SIGMA_OF_95 * float(np.sqrt(after)), float(np.sqrt(variance - after))

        def within(size: float, spread: float = spread) -> float:
            return float(ndtr((size - mean) / spread) - ndtr((-size - mean) / spread))

        undecided = within(limit + margin) - within(max(limit - margin, 0.0))
        found.append(Deciding(name, 2.0 * u, 1.0 - undecided))
    return tuple(sorted(found, key=lambda each: -each.U))


def latest_u(series: Series) -> Mapping[str, float]:
    """The standard uncertainty of the last result of each method."""
    return dict(zip(series.methods, series.u.tolist(), strict=True))
