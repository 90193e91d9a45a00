"""Jumps and waves in a continuous run: table steps of a control, and cyclic errors.

A jump is a position where straight lines through the blocks before and behind differ by far more than usual. A wave
is a line in the spectrum over position as narrow as the travel allows; a wider peak is a vibration. A wave with the
same phase over position in every run of a direction belongs to the axis; otherwise it is bound to time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.continuous.error_curve import Course
from kinematics.transforms import Array

SIDES = (8, 24)
"""Number of blocks on either side for the detection of a jump."""
JUMP = 7.0
"""Threshold of a jump, robust standard deviations."""
MOST_JUMPS = 400
LEAST_PERIODS_OF_TRAVEL = 8.0
"""Least number of periods of a cyclic error over the travel; the curve represents longer periods."""
FALSE_ALARM = 1e-4
"""Probability that noise is reported as a wave."""
BACKGROUND_BINS = 12
"""Number of spectral bins on either side for the background of a line."""
NARROW_BINS = (4, 8)
"""Range of bins from a line in which its power must have fallen by FALLEN."""
FALLEN = 5.0
WAVE_TRIES = 24
PARTS_OF_TRAVEL = 6
"""Number of parts of the travel in which a wave is evaluated."""
RANDOM_PHASES_P = 0.01
"""Probability that random phases are taken for a wave."""
RUN_VARIANCE_RATIO = 10.0
"""Ratio of the variance of a wave between runs to that within, from which it does not belong to the axis."""
REGULAR = 0.1
"""Largest deviation of jumps from equal spacing, as a share of the pitch."""
LEAST_REGULAR = 4


class Found(NamedTuple):
    """Features of the runs of one direction."""

    jumps: tuple[float, ...]
    """Positions of the jumps, mm."""
    periods: tuple[float, ...]
    """Periods of the waves of the axis, mm."""
    bound_to_time: tuple[tuple[float, float], ...]
    """Frequency, Hz, and amplitude, um, of the waves bound to time."""


def features(courses: Sequence[Course]) -> Found:
    """Jumps and waves of the courses of one direction: detected in the longest course, waves checked in all."""
    main = max(courses, key=len)
    positions = jumps(main)
    bare = [without_jumps(course, positions) for course in courses]
    left = bare[courses.index(main)]
    length = float(np.ptp(main.x))
    kept: list[float] = []
    loose: list[tuple[float, float]] = []
    barred: list[float] = []
    for _ in range(WAVE_TRIES):
        number = _line(main, left, barred)
        if number is None:
            break
        barred.append(number)
        period = _refined([(main, left)], length / number, length)
        period = _refined(list(zip(courses, bare, strict=True)), period, length)
        parts = np.array([_parts(*each, period) for each in zip(courses, bare, strict=True)])
        if not _keeps_phase(parts):
            continue
        left = _without(main, left, period)
        if _keeps_position(parts):
            kept.append(period)
        else:
            loose.append((main.speed / period, float(np.mean(np.abs(parts.mean(axis=1))))))
    return Found(positions, tuple(kept), tuple(loose))


def jumps(course: Course) -> tuple[float, ...]:
    """Positions of jumps of the error, mm, ascending."""
    taken = np.zeros(len(course), bool)
    positions: list[float] = []
    for side in SIDES:
        if len(course) < 8 * side:
            continue
        size = np.abs(_disagreement(course.error, side))
        scale = 1.4826 * float(np.median(size))
        beside = np.lib.stride_tricks.sliding_window_view(np.pad(size, side), 2 * side + 1).max(axis=1)
        peaks = np.flatnonzero((size >= beside) & (size > JUMP * scale))
        for peak in peaks[np.argsort(-size[peaks])].tolist():
            near = slice(max(peak - side, 0), peak + side + 1)
            if not taken[near].any() and 0 < peak < len(course):
                taken[peak] = True
                positions.append(float(course.x[peak - 1] + course.x[peak]) / 2.0)
    return tuple(sorted(positions)) if len(positions) <= MOST_JUMPS else ()


def without_jumps(course: Course, positions: Sequence[float]) -> Array:
    """Errors `(n,)`, um, without the jumps at these positions."""
    if not positions:
        return course.error
    ascending = course.x[-1] > course.x[0]
    x, error = (course.x, course.error) if ascending else (course.x[::-1], course.error[::-1])
    side = SIDES[0]
    size = _disagreement(error, side)
    at = np.clip(np.searchsorted(x, np.array(positions)), 0, len(x) - 1)
    level = np.zeros(len(x))
    np.add.at(level, at, size[at])
    left = error - np.cumsum(level)
    return left if ascending else left[::-1]


def without_waves(course: Course, error: Array, found: Found) -> Array:
    """Errors `(n,)`, um, without the waves found, bound to position or to time."""
    loose = [course.speed / frequency for frequency, _ in found.bound_to_time]
    for period in (*found.periods, *loose):
        error = _without(course, error, period)
    return error


def pitch_of(positions: Sequence[float], grain: float) -> tuple[float, float] | None:
    """Pitch and its standard uncertainty, mm, of equally spaced jumps; None if they are not equally spaced.

    `grain`: length, mm, within which the position of a jump is unknown.
    """
    if len(positions) < LEAST_REGULAR:
        return None
    at = np.array(positions)
    steps = np.diff(at)
    pitch = float(np.median(steps))
    numbers = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps / pitch), 1.0))])
    pitch, start = np.polyfit(numbers, at, 1).tolist()
    off = at - start - pitch * numbers
    if np.mean(np.abs(off) < REGULAR * pitch) < 0.8:
        return None
    spread = float(np.sqrt((np.mean(off**2) + grain**2 / 12.0) / np.sum((numbers - numbers.mean()) ** 2)))
    return float(pitch), spread


def _disagreement(error: Array, side: int) -> Array:
    """Step `(n,)` at each block: line through `side` blocks from it on, minus line through `side` blocks before it."""
    offsets = np.arange(side) + 0.5
    design = np.stack([np.ones(side), offsets], axis=1)
    weights = np.linalg.pinv(design)[0]
    ahead = np.correlate(error, weights, mode="valid")
    behind = np.correlate(error, weights[::-1], mode="valid")
    size = np.zeros(len(error))
    size[side : len(error) - side + 1] = ahead[side:] - behind[: len(behind) - side]
    return size


def _parts(course: Course, error: Array, period: float) -> list[complex]:
    """Amplitudes of a wave in parts of the travel, um, with their phases over position."""
    values = []
    for rows in np.array_split(np.arange(len(course)), PARTS_OF_TRAVEL):
        x, level = course.x[rows], error[rows]
        scaled = (x - x.mean()) / np.ptp(x)
        level = level - np.polyval(np.polyfit(scaled, level, 3), scaled)
        weights = np.hanning(len(rows))
        values.append(2.0 * complex(np.sum(weights * level * np.exp(2j * np.pi * x / period)) / weights.sum()))
    return values


def _keeps_phase(parts: np.ndarray) -> bool:
    """True if parts `(runs, parts)` agree in phase more than random ones (`RANDOM_PHASES_P`).

    The parts of one run at least must agree: a vibration loses its phase.
    """
    share = np.abs(parts.sum(axis=1)) ** 2 / (PARTS_OF_TRAVEL * np.sum(np.abs(parts) ** 2, axis=1))
    together = abs(parts.sum()) ** 2 / (parts.size * np.sum(np.abs(parts) ** 2))
    return bool(
        share.max() > 1.0 - RANDOM_PHASES_P ** (1.0 / (PARTS_OF_TRAVEL - 1))
        or together > 1.0 - RANDOM_PHASES_P ** (1.0 / (parts.size - 1))
    )


def _keeps_position(parts: np.ndarray) -> bool:
    """True if the runs `(runs, parts)` agree in amplitude and phase over position within the scatter of their parts."""
    runs = len(parts)
    means = parts.mean(axis=1)
    variance = np.mean(np.abs(parts - means[:, None]) ** 2) / (PARTS_OF_TRAVEL - 1)
    return runs == 1 or float(np.sum(np.abs(means - means.mean()) ** 2)) < RUN_VARIANCE_RATIO * (runs - 1) * float(
        variance
    )


def _line(course: Course, error: Array, barred: Sequence[float]) -> float | None:
    """Number of periods over the travel of the strongest spectral line; None if only barred lines remain."""
    n = len(course)
    raster = np.linspace(course.x.min(), course.x.max(), n)
    order = np.argsort(course.x)
    values = np.interp(raster, course.x[order], error[order])
    trend = np.polyval(np.polyfit(np.linspace(-1, 1, n), values, 3), np.linspace(-1, 1, n))
    power = np.abs(np.fft.rfft((values - trend) * np.hanning(n))) ** 2
    first, last = math.ceil(LEAST_PERIODS_OF_TRAVEL), len(power) - BACKGROUND_BINS - 1
    if last <= first + 2 * BACKGROUND_BINS:
        return None
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(power, BACKGROUND_BINS, mode="edge"), 2 * BACKGROUND_BINS + 1
    )
    level = np.median(around, axis=1) / math.log(2.0)
    threshold = math.log(n / FALSE_ALARM)
    far = [np.roll(power, shift) for each in range(*NARROW_BINS) for shift in (each, -each)]
    fallen = power > FALLEN * np.max(far, axis=0)
    strong = np.where(fallen & (power > threshold * level), power / level, 0.0)
    strong[:first] = strong[last:] = 0.0
    for number in barred:
        strong[max(round(number) - 2, 0) : round(number) + 3] = 0.0
    best = int(np.argmax(strong))
    return float(best) if strong[best] > 0.0 else None


def _refined(runs: Sequence[tuple[Course, Array]], period: float, length: float) -> float:
    """The period, mm, of the largest power in all runs together, within the resolution of the travel."""
    weighted = [(course.x, _weighted(course, error)) for course, error in runs]
    step = 1.0
    number = length / period
    for _ in range(12):
        tried = number + step * np.array([-1.0, 0.0, 1.0])
        power = [abs(sum(_amount(*run, length / each) for run in weighted)) for each in tried.tolist()]
        number = float(tried[int(np.argmax(power))])
        step /= 2.0
    return length / number


def _without(course: Course, error: Array, period: float) -> Array:
    value = _amount(course.x, _weighted(course, error), period)
    phase = 2.0 * np.pi * course.x / period
    return np.asarray(error - value.real * np.cos(phase) - value.imag * np.sin(phase))


def _weighted(course: Course, error: Array) -> Array:
    """Errors `(n,)` without a cubic trend, with Hann weights over the travel of sum 2."""
    scaled = (course.x - course.x.mean()) / np.ptp(course.x)
    weights = np.cos(np.pi * (course.x - course.x.min() - np.ptp(course.x) / 2.0) / np.ptp(course.x)) ** 2
    return np.asarray(2.0 * weights / weights.sum() * (error - np.polyval(np.polyfit(scaled, error, 3), scaled)))


def _amount(x: Array, weighted: Array, period: float) -> complex:
    """Amplitude of a wave, um: cosine part real, sine part imaginary."""
    return complex(weighted @ np.exp(2j * np.pi / period * x))
