"""Times of the samples: the time stamps, or the uniform clock behind stamps that scatter.

At 10,000 mm/min a stamp that is 1 ms late is an error of 167 um. A laser samples with its own clock. If the median
deviation of the stamps from a uniform clock is at most a quarter of its period, the times of this clock are used,
provided that they make the motion smoother.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.continuous.records import Record
from calibration.continuous.segment import noise_of
from kinematics.transforms import Array

FIRST_STAMPS, STAMPS_GROWTH, TRIAL_PERIODS, FIRST_PERIOD_WIDTH = 32, 4, 17, 0.1
"""Search for the period: first number of stamps, its growth factor, number of trial periods, first relative width."""
NEIGHBOUR_STAMPS = 15
"""Number of neighbours whose median distinguishes a lost sample from a late stamp."""
CLOCK_NOISE_RATIO = 0.8
"""Ratio of the noise with the uniform clock to that with the stamps, below which the clock is used."""
FEWEST_STAMPS = 20


def clocked(record: Record) -> tuple[Record, list[str]]:
    """The record with the better times, and a note if these are not the time stamps."""
    time, displacement = record.time, record.displacement
    if len(time) < FEWEST_STAMPS:
        return record, []
    slots, period = raster(time)
    period, start = np.polyfit(slots, time, 1).tolist()
    even = start + period * slots
    late = time - even
    if np.any(np.diff(slots) < 1) or np.median(np.abs(late)) > 0.25 * period:
        return record, []
    speed = (displacement[-1] - displacement[0]) / (time[-1] - time[0])
    stamped, clocked_noise = (noise_of(displacement - speed * each) for each in (time, even))
    if clocked_noise >= CLOCK_NOISE_RATIO * stamped:
        return record, []
    scatter = np.std(late) * 1e6
    note = f"run {record.name}: time stamps scatter by {scatter:.3g} us about an even clock, which is used instead"
    return replace(record, time=even), [note]


def raster(time: Array) -> tuple[np.ndarray, float]:
    """Indices `(n,)` of the samples in a uniform time raster, from 0, and its period, s."""
    period = _period(time)
    lost = (time - time[0]) / period - np.arange(len(time))
    lost -= np.angle(np.mean(np.exp(2j * np.pi * lost))) / (2.0 * np.pi)  # the first stamp scatters too
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(lost, NEIGHBOUR_STAMPS // 2, mode="edge"), NEIGHBOUR_STAMPS
    )
    whole = np.maximum.accumulate(np.round(np.median(around, axis=1)).astype(int))
    return np.arange(len(time)) + whole - whole[0], period


def _period(time: Array) -> float:
    """The period, s, that fits the stamps best even if samples are lost: over a few stamps first, over all at last."""
    period, size = float(np.median(np.diff(time))), FIRST_STAMPS
    width = FIRST_PERIOD_WIDTH
    while True:
        part = time[:size] - time[0]
        tried = period * (1.0 + width * np.linspace(-1.0, 1.0, TRIAL_PERIODS))
        kept = [abs(np.sum(np.exp(2j * np.pi / each * part))) for each in tried.tolist()]
        period = float(tried[int(np.argmax(kept))])
        if size >= len(time):
            return period
        size, width = size * STAMPS_GROWTH, 1.0 / size
