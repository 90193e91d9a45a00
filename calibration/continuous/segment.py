"""Segment of constant velocity: the part of a record without ramps, their tails, and settling vibration.

Speeds are differences of means over a span of samples, long enough that noise and short waves of the axis are small
against the feed. The plateau is the longest segment within a tolerance of the usual speed.

At its start, the ramp is assumed to decay with the time constant that the speed shows between `RAMP_DEVIATION` and the
tolerance; the segment begins when the effect of the ramp on the displacement is below TAIL_MM. The speed takes some
time from the tolerance to `RAMP_DEVIATION` at the final ramp; the segment ends earlier than the plateau by the same
time. Ends that vibrate more than the middle are then left out. The test of Miller et al. 2017, 4.1 (all samples within
two standard deviations) rejects normal noise and neglects the tails.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from calibration.continuous.records import Record
from kinematics.transforms import Array
from kinematics.user_error import UserError

FAST = 0.9
"""Share of the 95 % quantile of the speeds above which the axis counts as on its plateau."""
LEAST_TOLERANCE, MOST_TOLERANCE = 0.01, 0.1
"""Limits of the relative tolerance of the speed on the plateau; between them it is four times the spread."""
RAMP_DEVIATION = 0.2
"""Relative deviation of the speed that only a ramp causes."""
SPEED_NOISE = 0.003
"""Relative noise of the speed for which the span is chosen."""
TAIL_MM = 5e-5
"""Largest remaining effect of a ramp on the displacement, mm."""
RESTLESS = 2.5
"""Ratio of the vibration energy to that of the middle, above which an end still settles."""
SETTLES = 0.25
"""Share of the plateau at either end that is searched for settling."""
LEAST_SAMPLES = 100
BRIDGED = 200
"""Longest interruption of the plateau: the length of the record over this number, or four spans if longer."""
MOST_SPANS, FEWEST_SPANS = 50, 20
"""Longest span: the record's length over the first number; over the second if the axis moves unevenly."""
CALM = 0.02
"""Spread of the relative speed below which no longer span is tried."""
CALM_S = 0.01
"""Step of the second difference that shows vibration, s."""


class Segment(NamedTuple):
    """Samples `[first, stop)` of a record at constant velocity."""

    first: int
    stop: int
    speed: float
    """Speed, mm/s, positive."""
    sample_s: float
    """Median time between samples, s."""
    notes: tuple[str, ...]


def constant_velocity(record: Record) -> Segment:
    """The segment of constant velocity of a record; UserError if there is none."""
    time, travelled = record.time, record.displacement * record.direction
    if len(record) < LEAST_SAMPLES:
        raise UserError(f"{record.source}: {len(record)} samples of run {record.name}, at least {LEAST_SAMPLES} needed")
    sample = float(np.median(np.diff(time)))
    span = _span(record, travelled, sample)
    while True:
        speed = _speeds(time, travelled, span)
        usual = _usual(speed, record)
        off = np.abs(speed / usual - 1.0)
        spread = 1.4826 * float(np.median(off[speed > usual / 2.0]))
        if spread < CALM or 2 * span > len(record) // FEWEST_SPANS:
            break
        span *= 2
    tolerance = min(max(LEAST_TOLERANCE, 4.0 * spread), MOST_TOLERANCE)
    first, stop = _longest(off <= tolerance, max(4 * span, len(off) // BRIDGED))
    notes = []
    elsewhere = np.count_nonzero(off <= tolerance) - (stop - first)
    if elsewhere > 0.05 * (stop - first):
        notes.append(
            f"run {record.name}: the feed changes during the run; only its longest part at constant feed is used"
        )
    first, stop = _without_ramps(time, off, first, stop, (tolerance, usual), span, sample)
    first, stop, settling = _without_vibration(travelled - usual * time, first, stop, sample)
    if settling:
        notes.append(f"run {record.name}: {settling}")
    if stop - first < LEAST_SAMPLES:
        raise UserError(
            f"{record.source}: run {record.name} moves at constant velocity for {max(stop - first, 0)} samples only, "
            f"at least {LEAST_SAMPLES} needed: a longer travel, a lower feed, or a higher sampling rate"
        )
    return Segment(first, stop, usual, sample, tuple(notes))


def noise_of(values: Array) -> float:
    """Standard deviation of white noise, robust to outliers; third differences remove the smooth part of the values."""
    third = np.diff(values, n=3)
    return 1.4826 * float(np.median(np.abs(third - np.median(third)))) / math.sqrt(20.0)


def _span(record: Record, travelled: Array, sample: float) -> int:
    """Number of samples in the means on both sides of a speed."""
    rough = abs(record.feed) / 60.0
    needed = (noise_of(travelled) * math.sqrt(2.0) / (SPEED_NOISE * rough * sample)) ** (2.0 / 3.0)
    return int(min(max(math.ceil(needed), 2), max(len(travelled) // MOST_SPANS, 2)))


def _speeds(time: Array, travelled: Array, span: int) -> Array:
    """Speeds `(n,)`, mm/s, at all samples; the first and last `span` samples take the nearest value."""

    def means(values: Array) -> Array:
        sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
        return np.asarray((sums[span:] - sums[:-span]) / span)

    position, time_of = means(travelled), means(time)
    inner = (position[span:] - position[:-span]) / (time_of[span:] - time_of[:-span])
    return np.asarray(np.pad(inner, (span, len(travelled) - len(inner) - span), mode="edge"))


def _usual(speed: Array, record: Record) -> float:
    """Speed on the plateau, mm/s; UserError if the axis moves backward, there and back, or not at all."""
    high, low = np.quantile(speed, [0.95, 0.05]).tolist()
    if high < -low:
        raise UserError(
            f"{record.source}: the displacement of run {record.name} decreases while the axis moves from "
            f"{record.start:g} to {record.end:g} mm: reverse its sign, or correct '# start_mm' and '# end_mm'"
        )
    if high <= 0.0:
        raise UserError(
            f"{record.source}: the displacement of run {record.name} does not change: the axis did not move"
        )
    if low < -RAMP_DEVIATION * high:
        raise UserError(
            f"{record.source}: run {record.name} moves forward and backward: give each traverse its own run or "
            "direction"
        )
    return float(np.median(speed[speed > FAST * high]))


def _longest(steady: np.ndarray, bridged: int) -> tuple[int, int]:
    """First and last + 1 of the longest segment; interruptions up to `bridged` samples do not end it."""
    at = np.flatnonzero(steady)
    ends = np.flatnonzero(np.diff(at) > bridged)
    firsts, lasts = at[np.append(0, ends + 1)], at[np.append(ends, len(at) - 1)]
    best = int(np.argmax(lasts - firsts))
    return int(firsts[best]), int(lasts[best]) + 1


def _without_ramps(
    time: Array, off: Array, first: int, stop: int, plateau: tuple[float, float], span: int, sample: float
) -> tuple[int, int]:
    """The segment without the tails of the ramps; `plateau`: relative tolerance and speed, mm/s."""
    tolerance, usual = plateau
    before = np.flatnonzero(off[:first] >= RAMP_DEVIATION)
    if len(before):
        constant = max(float(time[first] - time[before[-1]]) / math.log(RAMP_DEVIATION / tolerance), sample)
        left = tolerance * usual * constant
        wait = constant * max(math.log(left / TAIL_MM), 0.0) + span * sample
        first = int(np.searchsorted(time, time[first] + wait))
    after = np.flatnonzero(off[stop:] >= RAMP_DEVIATION)
    if len(after):
        margin = float(time[stop + after[0]] - time[stop - 1]) + 2 * span * sample
        stop = int(np.searchsorted(time, time[stop - 1] - margin))
    return first, max(stop, first)


def _without_vibration(course: Array, first: int, stop: int, sample: float) -> tuple[int, int, str]:
    """The segment without ends that vibrate more than its middle, and a note on the time left out.

    course: displacement minus the motion at constant speed, mm.
    """
    n = stop - first
    half, window = max(round(CALM_S / sample), 1), max(50, n // 100)
    if n < 8 * window:
        return first, stop, ""
    inner = course[first:stop]
    second_differences = inner[2 * half :] - 2.0 * inner[half:-half] + inner[: -2 * half]
    sums = np.concatenate([[0.0], np.cumsum(second_differences**2)])
    energy = (sums[window::window] - sums[:-window:window]) / window
    calm = energy <= RESTLESS * np.median(energy)
    most = int(SETTLES * len(calm))
    start = _restless(calm[:most]) * window
    end = _restless(calm[::-1][:most]) * window
    if not start and not end:
        return first, stop, ""
    lost = (start + end) * sample
    return first + start, stop - end, f"{lost:.3g} s at the ends are left out, where the axis still vibrates"


def _restless(calm: np.ndarray) -> int:
    """Number of windows before the first two consecutive calm ones; 0 if there are none."""
    both = np.flatnonzero(calm[:-1] & calm[1:])
    return int(both[0]) if len(both) else 0
