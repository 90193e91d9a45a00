"""Where the axis moved at constant velocity: the part of a record without ramps, their tails, and settling vibration.

Speeds are differences of means over a span of samples, long enough for the noise, and the axis' own short waves, to be
small against the feed. The plateau is the longest stretch within a tolerance of the usual speed; where it begins, what
is left of the ramp is taken to die away with the time constant that the speed shows between FAR and the tolerance, and
the segment begins when that is below TAIL_MM; where it ends, as long before the tolerance is reached as the speed takes
from there to FAR. What still vibrates more than the middle at either end is then left out. Against Miller et al. 2017,
4.1, whose test (all samples within two standard deviations) no normal noise passes, and which knows no tails.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from calibration.continuous.records import Record
from kinematics.transforms import Array
from kinematics.user_error import UserError

FAST = 0.9
"""Share of the 95 % quantile of speeds above which the axis is taken to be on its plateau."""
LEAST_TOLERANCE, MOST_TOLERANCE = 0.01, 0.1
"""Relative, of the speed on the plateau; between them four times its spread."""
FAR = 0.2
"""Relative deviation of the speed that is a ramp and nothing else."""
SPEED_NOISE = 0.003
"""Relative noise of the speed that the span is chosen for."""
TAIL_MM = 5e-5
"""What a ramp may leave in the displacement."""
RESTLESS = 2.5
"""Times the energy of the middle, above which an end still settles."""
SETTLES = 0.25
"""Share of the plateau at either end in which that is looked for."""
LEAST_SAMPLES = 100
BRIDGED = 200
"""Share of the record, one in so many, that an interruption of the plateau may last; or four spans."""
MOST_SPANS, FEWEST_SPANS = 50, 20
"""The span is at most the record's length over the first; where the axis itself moves unevenly, over the second."""
CALM = 0.02
"""Spread of the relative speed that a longer span is not asked for."""
CALM_S = 0.01
"""Half-length of the second difference that shows vibration."""


class Segment(NamedTuple):
    """Samples `[first, stop)` of a record at constant velocity."""

    first: int
    stop: int
    speed: float
    """mm/s, positive."""
    sample_s: float
    """Usual time between samples."""
    moving_mm: float
    """The whole way of the record, without rests."""
    notes: tuple[str, ...]


def constant_velocity(record: Record) -> Segment:
    """The segment of a record; UserError when it has none."""
    time, way = record.time, record.displacement * record.direction
    if len(record) < LEAST_SAMPLES:
        raise UserError(f"{record.source}: {len(record)} samples of run {record.name}, at least {LEAST_SAMPLES} needed")
    sample = float(np.median(np.diff(time)))
    span = _span(record, way, sample)
    while True:
        speed = _speeds(time, way, span)
        usual = _usual(speed, record)
        off = np.abs(speed / usual - 1.0)
        spread = 1.4826 * float(np.median(off[speed > usual / 2.0]))
        if spread < CALM or 2 * span > len(record) // FEWEST_SPANS:
            break
        span *= 2
    tolerance = min(max(LEAST_TOLERANCE, 4.0 * spread), MOST_TOLERANCE)
    first, stop = _longest(off <= tolerance, max(4 * span, len(off) // BRIDGED))
    notes = []
    moving = np.flatnonzero(speed > 0.02 * usual)
    elsewhere = np.count_nonzero(off <= tolerance) - (stop - first)
    if elsewhere > 0.05 * (stop - first):
        notes.append(f"run {record.name}: the feed changes on the way; only its longest constant stretch is used")
    first, stop = _without_ramps(time, off, first, stop, (tolerance, usual), span, sample)
    first, stop, settling = _settled(way - usual * time, first, stop, sample)
    if settling:
        notes.append(f"run {record.name}: {settling}")
    if stop - first < LEAST_SAMPLES:
        raise UserError(
            f"{record.source}: run {record.name} moves at constant velocity for {max(stop - first, 0)} samples only, "
            f"at least {LEAST_SAMPLES} needed: a longer travel, a lower feed, or a higher sampling rate"
        )
    moved = float(way[moving[-1]] - way[moving[0]])
    return Segment(first, stop, usual, sample, moved, tuple(notes))


def noise_of(values: Array) -> float:
    """Standard deviation of white noise on a course that third differences take away, whatever outliers it has."""
    third = np.diff(values, n=3)
    return 1.4826 * float(np.median(np.abs(third - np.median(third)))) / math.sqrt(20.0)


def _span(record: Record, way: Array, sample: float) -> int:
    """Samples over which a mean is taken on both sides of a speed."""
    rough = abs(record.feed) / 60.0
    wanted = (noise_of(way) * math.sqrt(2.0) / (SPEED_NOISE * rough * sample)) ** (2.0 / 3.0)
    return int(min(max(math.ceil(wanted), 2), max(len(way) // MOST_SPANS, 2)))


def _speeds(time: Array, way: Array, span: int) -> Array:
    """Speeds `(n,)`, mm/s, at all samples; those of the first and last `span` are their neighbours'."""

    def means(values: Array) -> Array:
        sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
        return np.asarray((sums[span:] - sums[:-span]) / span)

    place, moment = means(way), means(time)
    inner = (place[span:] - place[:-span]) / (moment[span:] - moment[:-span])
    return np.asarray(np.pad(inner, (span, len(way) - len(inner) - span), mode="edge"))


def _usual(speed: Array, record: Record) -> float:
    """Speed on the plateau, mm/s; UserError when the axis goes the other way, or nowhere."""
    high, low = np.quantile(speed, [0.95, 0.05]).tolist()
    if high < -low:
        raise UserError(
            f"{record.source}: the displacement of run {record.name} falls where the axis goes from "
            f"{record.start:g} to {record.end:g} mm: turn its sign, or mend '# start_mm' and '# end_mm'"
        )
    if high <= 0.0:
        raise UserError(f"{record.source}: the displacement of run {record.name} does not change: the axis stood")
    if low < -FAR * high:
        raise UserError(
            f"{record.source}: run {record.name} goes there and back: give each traverse its own run or direction"
        )
    return float(np.median(speed[speed > FAST * high]))


def _longest(steady: np.ndarray, bridged: int) -> tuple[int, int]:
    """First and last + 1 of the longest stretch; interruptions up to `bridged` samples don't end it."""
    at = np.flatnonzero(steady)
    ends = np.flatnonzero(np.diff(at) > bridged)
    firsts, lasts = at[np.append(0, ends + 1)], at[np.append(ends, len(at) - 1)]
    best = int(np.argmax(lasts - firsts))
    return int(firsts[best]), int(lasts[best]) + 1


def _without_ramps(
    time: Array, off: Array, first: int, stop: int, plateau: tuple[float, float], span: int, sample: float
) -> tuple[int, int]:
    """The stretch without what the ramps leave in it; plateau: its tolerance and speed, mm/s."""
    tolerance, usual = plateau
    before = np.flatnonzero(off[:first] >= FAR)
    if len(before):
        constant = max(float(time[first] - time[before[-1]]) / math.log(FAR / tolerance), sample)
        left = tolerance * usual * constant
        wait = constant * max(math.log(left / TAIL_MM), 0.0) + span * sample
        first = int(np.searchsorted(time, time[first] + wait))
    after = np.flatnonzero(off[stop:] >= FAR)
    if len(after):
        margin = float(time[stop + after[0]] - time[stop - 1]) + 2 * span * sample
        stop = int(np.searchsorted(time, time[stop - 1] - margin))
    return first, max(stop, first)


def _settled(course: Array, first: int, stop: int, sample: float) -> tuple[int, int, str]:
    """The stretch without ends that vibrate more than its middle, and what was left out, in words.

    course: displacement less the motion at constant speed.
    """
    n = stop - first
    half, window = max(round(CALM_S / sample), 1), max(50, n // 100)
    if n < 8 * window:
        return first, stop, ""
    inner = course[first:stop]
    bend = inner[2 * half :] - 2.0 * inner[half:-half] + inner[: -2 * half]
    sums = np.concatenate([[0.0], np.cumsum(bend**2)])
    energy = (sums[window::window] - sums[:-window:window]) / window
    calm = energy <= RESTLESS * np.median(energy)
    most = int(SETTLES * len(calm))
    begin = _restless(calm[:most]) * window
    end = _restless(calm[::-1][:most]) * window
    if not begin and not end:
        return first, stop, ""
    lost = (begin + end) * sample
    return first + begin, stop - end, f"{lost:.3g} s at the ends left out, where the axis still vibrates"


def _restless(calm: np.ndarray) -> int:
    """Windows from the beginning up to the first two that are calm; 0 where none are."""
    both = np.flatnonzero(calm[:-1] & calm[1:])
    return int(both[0]) if len(both) else 0
