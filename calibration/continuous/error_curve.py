"""From displacement against time to error against position, up to a straight line; blocks of equal length in time.

Inside the segment the command is linear in time, x = x0 + v t. Its position along the axis follows from the standstill
at `start` or `end`, where the axis has the error of the quasi-static curve (Miller et al. 2017, 4.4). x0 and v are
those of least squares after subtraction of that curve, so that positions are as accurate as the curve. The difference,
displacement minus x, is the error of the axis up to a straight line, which this run cannot show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calibration.continuous.clock import raster
from calibration.continuous.records import QuasiStatic, Record
from calibration.continuous.segment import Segment, noise_of
from kinematics.transforms import Array
from kinematics.user_error import UserError

MOST_SAMPLE_BLOCKS = 16_384
"""Largest number of blocks of samples; the finest detail is the travel over a quarter of it."""
SPIKE = 8.0
"""Robust standard deviations from the median of its neighbours beyond which a sample is a fault of the beam."""
NEIGHBOURS = 7
STANDSTILL_FEED_SHARE = 0.01
"""Share of the feed below which the axis is at rest."""
STANDSTILL_S = 0.1
"""Least duration of a rest, s."""
RESTS_AGREE_MM = 0.2
"""Largest difference, mm, of the positions of the run that follow from the two rests."""


@dataclass(frozen=True)
class Course:
    """One traverse at constant velocity, prepared for the fit."""

    record: Record
    segment: Segment
    x: Array
    """Commanded positions `(n,)` of blocks, mm, ascending or descending with the motion."""
    error: Array
    """Error `(n,)`, um, up to a straight line in x."""
    slot: np.ndarray
    """Index `(n,)` of each block in a uniform time raster; a gap is an index without a block."""
    period_s: float
    """Period of the raster, s."""
    samples: np.ndarray
    """Number of samples `(n,)` in each block."""
    raw_x: Array
    """Commanded positions of the samples used, mm; `raw_error`: their errors, um, up to the same line."""
    raw_error: Array
    feed: float
    """Mean feed, mm/min, corrected for the quasi-static scale."""
    dropped: int
    """Number of samples left out as faults of the beam."""
    missing: int
    """Number of samples that are missing in the time raster."""
    notes: tuple[str, ...]

    def moved(self, offset: float, slope: float) -> Course:
        """The course with errors larger by a line, um and um per mm, and positions smaller by the same amount.

        Displacement is the sum of position and error.
        """
        line, raw = offset + slope * self.x, offset + slope * self.raw_x
        return replace(
            self,
            x=self.x - line * 1e-3,
            error=self.error + line,
            raw_x=self.raw_x - raw * 1e-3,
            raw_error=self.raw_error + raw,
            feed=self.feed * (1.0 - slope * 1e-3),
        )

    @property
    def speed(self) -> float:
        """Speed, mm/s, positive."""
        return self.feed / 60.0

    def __len__(self) -> int:
        return len(self.x)


def course_of(record: Record, segment: Segment, quasi: QuasiStatic) -> Course:
    """The course of a record in its segment; UserError if its position along the axis is unknown."""
    curve = quasi.curve(record.direction)
    shift, notes = _shift(record, segment, curve)
    rows = slice(segment.first, segment.stop)
    time, displacement = record.time[rows], record.displacement[rows] + shift
    slots, period = raster(time)
    kept = ~_spikes(time, displacement)
    time, displacement, slots = time[kept] - time[0], displacement[kept], slots[kept]
    rough = displacement - np.interp(displacement, *curve) * 1e-3
    speed, x0 = np.polyfit(time - time.mean(), rough, 1).tolist()
    x = x0 + speed * (time - time.mean())
    error = (displacement - x) * 1e3
    factor = math.ceil(len(x) / MOST_SAMPLE_BLOCKS)
    block = slots // factor
    firsts = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(firsts, len(block)))
    return Course(
        record,
        segment,
        np.add.reduceat(x, firsts) / count,
        np.add.reduceat(error, firsts) / count,
        block[firsts],
        factor * period,
        count,
        x,
        error,
        abs(speed) * 60.0,
        int(np.count_nonzero(~kept)),
        int(slots[-1] + 1 - slots[0] - len(slots) - np.count_nonzero(~kept)),
        tuple(notes),
    )


def _shift(record: Record, segment: Segment, curve: tuple[Array, Array]) -> tuple[float, list[str]]:
    """Offset from displacement to position, mm, from the rests at both ends or at one; notes."""
    found = []
    for standstill, displacement in zip(_standstills(record, segment), (record.start, record.end), strict=True):
        if standstill is not None:
            found.append(displacement + float(np.interp(displacement, *curve)) * 1e-3 - standstill)
    if len(found) == 2 and abs(found[0] - found[1]) > RESTS_AGREE_MM:
        raise UserError(
            f"{record.source}: run {record.name} moves, from standstill to standstill, "
            f"{abs(record.end - record.start) + record.direction * (found[0] - found[1]):.4f} mm, its header states "
            f"{abs(record.end - record.start):g}: correct '# start_mm' and '# end_mm' (where the axis is at "
            "standstill), or the unit"
        )
    if found:
        return float(np.mean(found)), []
    low, high = sorted((record.start, record.end))
    displacements = record.displacement - np.interp(record.displacement, *curve) * 1e-3
    if np.any((displacements < low - RESTS_AGREE_MM) | (displacements > high + RESTS_AGREE_MM)):
        raise UserError(
            f"{record.source}: run {record.name} has no standstill before or after its motion, and its displacement is "
            f"not that from {low:g} to {high:g} mm: its position along the axis is unknown"
        )
    return 0.0, [
        f"run {record.name} has no standstill before or after its motion: its displacement is used as the position"
    ]


def _standstills(record: Record, segment: Segment) -> tuple[float | None, float | None]:
    """Displacement, mm, at rest before and after the motion; None if the record shows no rest."""
    least = max(round(STANDSTILL_S / segment.sample_s), 3)
    standstill_mm = STANDSTILL_FEED_SHARE * segment.speed * segment.sample_s * least
    found: list[float | None] = []
    for displacement in (record.displacement, record.displacement[::-1]):
        level = float(np.median(displacement[:least]))
        left = np.abs(displacement - level) > max(
            standstill_mm, 4.0 * noise_of(displacement[:least]) if least > 8 else standstill_mm
        )
        count = int(np.argmax(left)) if left.any() else len(displacement)
        stands_still = count >= least and float(np.ptp(displacement[: least // 2])) < standstill_mm + 8.0 * noise_of(
            displacement
        )
        found.append(float(np.median(displacement[: max(count // 2, 1)])) if stands_still else None)
    return found[0], found[1]


def _spikes(time: Array, displacement: Array) -> np.ndarray:
    """Mask `(n,)` of the samples far from the median of their neighbours."""
    level = displacement - np.polyval(np.polyfit(time - time.mean(), displacement, 1), time - time.mean())
    around = np.lib.stride_tricks.sliding_window_view(np.pad(level, NEIGHBOURS // 2, mode="edge"), NEIGHBOURS)
    off = np.abs(level - np.median(around, axis=1))
    scale = max(noise_of(level), 1.4826 * float(np.median(off)), 1e-7)
    return np.asarray(off > SPIKE * scale)
