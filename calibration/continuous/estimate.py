"""Continuous runs and a quasi-static measurement of one axis: the joint error table, cyclic errors and jumps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calibration.continuous.clock import clocked
from calibration.continuous.comparators import Comparison, comparisons_of
from calibration.continuous.error_curve import Course, course_of
from calibration.continuous.features import Found, features, pitch_of, without_jumps, without_waves
from calibration.continuous.fusion import Fused, fused
from calibration.continuous.noise import Noise, noise_of_course
from calibration.continuous.records import DIRECTION_NAMES, QuasiStatic, Record
from calibration.continuous.segment import constant_velocity
from calibration.continuous.shape import Extra, Shape, shape_of
from kinematics.transforms import Array
from kinematics.user_error import UserError

Direction = Literal["auto", "forward", "backward", "mean"]
TABLE_ROWS = 500
"""Approximate number of rows of a table without a given spacing."""
MOST_TABLE_ROWS = 4000
LEAST_TARGETS = 2
"""Least number of targets inside the segment, because the fit estimates a straight line."""
MOST_POSITION_ROUNDS, POSITION_TOLERANCE_UM = 8, 0.05
"""Iteration of positions from errors and errors from positions: largest number of rounds, and tolerance, um."""
FEED_OFF = 0.05
"""Relative difference of the feed from the programmed one above which a note is given."""
AGREES = 1.5
"""Ratio of the scatter of quasi-static readings to the instrument specification, above which other causes act."""

NO_BETTER = 0.9
"""Ratio of the scatter of the readings to that about straight lines, above which the runs do not explain them."""


class Wave(NamedTuple):
    """A cyclic error."""

    period_mm: float
    u_period_mm: float
    amplitude_um: float
    u_amplitude_um: float
    frequency_hz: float
    """Frequency at the feed of the run, Hz."""


class Jumps(NamedTuple):
    """Jumps of the error of one direction."""

    positions_mm: tuple[float, ...]
    sizes_um: tuple[float, ...]
    """Sizes, um; positive if the error rises in the positive direction of the axis."""
    u_um: tuple[float, ...]
    pitch: tuple[float, float] | None
    """Pitch and its standard uncertainty, mm, if the jumps are equally spaced."""


@dataclass(frozen=True)
class OneDirection:
    """Result of the continuous runs of one direction."""

    courses: tuple[Course, ...]
    noises: tuple[Noise, ...]
    shape: Shape
    found: Found
    waves: tuple[Wave, ...]
    jumps: Jumps


class TableRows(NamedTuple):
    """The error table: positions, mm; errors and standard uncertainties (k = 1), um."""

    position: Array
    error: Array
    u: Array
    continuous: np.ndarray
    """False at targets outside the segment, where only quasi-static readings exist."""


@dataclass(frozen=True)
class Estimate:
    """Joint estimate of the axis."""

    by_direction: Mapping[int, OneDirection]
    """Result of the continuous runs, by direction."""
    quasi: QuasiStatic
    fused: Fused
    direction: str
    """Direction of the table: forward, backward or mean."""
    comparisons: Mapping[str, Comparison]
    """Results of the methods of Miller et al. 2017, by name of the run."""
    notes: tuple[str, ...]

    @property
    def segment(self) -> tuple[float, float]:
        """Ends of the range that all continuous runs cover at constant velocity, mm."""
        return _common({sign: each.shape for sign, each in self.by_direction.items()})

    def curve(self, direction: str) -> tuple[Array, Array]:
        """Errors `(n,)` at the fused positions and their covariance, um and um2, without the instrument's scale.

        direction: forward, backward, mean, or reversal (forward minus backward).
        """
        shares = {"forward": (1.0, 0.0), "backward": (0.0, 1.0), "mean": (0.5, 0.5), "reversal": (1.0, -1.0)}
        share = dict(zip((1, -1), shares[direction], strict=True))
        values, covariance = self.fused.mixed([[share[sign] for sign in self.fused.signs]])
        return values, covariance

    def table(self, direction: str | None = None) -> TableRows:
        """The error table of a direction, with the targets outside the segment; u includes the instrument's scale."""
        direction = direction or self.direction
        error, covariance = self.curve(direction)
        x, u = self.fused.positions, np.sqrt(np.maximum(np.diag(covariance), 0.0))
        for sign in self.by_direction:
            if direction in ("mean", DIRECTION_NAMES[sign]) or len(self.by_direction) == 1:
                u = np.hypot(u, self.by_direction[sign].shape.u_near_jumps(x) * (0.5 if direction == "mean" else 1.0))
        beyond = _outside(self.fused, direction)
        x, error, u = (np.concatenate(pair) for pair in zip((x, error, u), beyond, strict=True))
        order = np.argsort(x)
        scale = self.quasi.u_per_m * 1e-3 * (x - self.quasi.target[0])
        inside_segment = np.arange(len(x)) < len(self.fused.positions)
        return TableRows(x[order], error[order], np.hypot(u, scale)[order], inside_segment[order])

    @property
    def both(self) -> bool:
        """True if the errors of both directions are known."""
        return len(self.fused.signs) == 2


def estimate(
    records: Sequence[Record],
    quasi: QuasiStatic,
    spacing: float | None = None,
    direction: Direction = "auto",
    positions: Array | None = None,
) -> Estimate:
    """The joint estimate; UserError for data that cannot be used.

    `spacing` of the table's rows, mm; or their `positions` `(n,)`, mm, inside the segment.
    """
    notes: list[str] = []
    used = _with_readings(records, quasi, notes)
    courses = {
        sign: _courses([r for r in used if r.direction == sign], quasi, notes)
        for sign in DIRECTION_NAMES
        if _has(used, sign)
    }
    for _ in range(MOST_POSITION_ROUNDS):
        by_direction = {sign: _one_direction(own) for sign, own in courses.items()}
        shapes = {sign: each.shape for sign, each in by_direction.items()}
        inside = _inside(shapes, quasi)
        at = _positions(*_common(shapes), spacing) if positions is None else positions
        requested = tuple(sign for sign in DIRECTION_NAMES if np.any(inside & (quasi.direction == sign)))
        found = fused(shapes, quasi, inside, at, requested)
        if _converged(shapes, found):
            break
        courses = {sign: tuple(course.moved(*found.lines[sign]) for course in own) for sign, own in courses.items()}
    else:
        notes.append(
            "the error changes so fast along the axis that its positions are uncertain: u_um does not contain this"
        )
    _refuse_unexplained(quasi, inside, found)
    chosen = _direction(direction, by_direction, found)
    for course in (course for each in by_direction.values() for course in each.courses):
        notes += _feed_notes(course)
    notes += _noise_notes(found)
    comparisons = comparisons_of([course for each in by_direction.values() for course in each.courses], quasi, inside)
    return Estimate(by_direction, quasi, found, chosen, comparisons, tuple(notes))


def _has(records: Sequence[Record], sign: int) -> bool:
    return any(record.direction == sign for record in records)


def _with_readings(records: Sequence[Record], quasi: QuasiStatic, notes: list[str]) -> list[Record]:
    """The records whose direction has quasi-static readings; UserError if there are none."""
    used = [record for record in records if np.any(quasi.direction == record.direction)]
    for record in records:
        if record not in used:
            notes.append(
                f"run {record.name} is not used: its position is unknown without a quasi-static reading in its "
                f"direction, {DIRECTION_NAMES[record.direction]}"
            )
    if not used:
        raise UserError(
            f"{quasi.source}: no quasi-static reading in the direction of the continuous run "
            f"({', '.join(sorted({DIRECTION_NAMES[record.direction] for record in records}))})"
        )
    return used


def _courses(records: Sequence[Record], quasi: QuasiStatic, notes: list[str]) -> tuple[Course, ...]:
    """The runs of one direction at constant velocity."""
    courses = []
    for record in records:
        timed, clock_notes = clocked(record)
        segment = constant_velocity(timed)
        course = course_of(timed, segment, quasi)
        notes += [*clock_notes, *segment.notes, *course.notes]
        courses.append(course)
    low = max(float(course.x.min()) for course in courses)
    high = min(float(course.x.max()) for course in courses)
    _check_targets(records[0], quasi, low, high)
    return tuple(courses)


def _converged(shapes: Mapping[int, Shape], found: Fused) -> bool:
    """True if the fitted lines shift the positions so little that errors change by less than the tolerance."""
    for sign, shape in shapes.items():
        offset, slope = found.lines[sign]
        ends = np.array(shape.interval)
        moved = float(np.abs(offset + slope * ends).max()) * 1e-3
        if moved * shape.steepest > POSITION_TOLERANCE_UM:
            return False
    return True


def _one_direction(courses: tuple[Course, ...]) -> OneDirection:
    """Result of the runs of one direction."""
    found = features(courses)
    bare = [without_waves(course, without_jumps(course, found.jumps), found) for course in courses]
    noises = tuple(
        noise_of_course(course, error, _difference(courses, bare, i))
        for i, (course, error) in enumerate(zip(courses, bare, strict=True))
    )
    shape = shape_of(courses, noises, Extra(found.jumps, found.periods))
    return OneDirection(courses, noises, shape, found, _waves(courses[0], shape), _jumps(shape))


def _check_targets(record: Record, quasi: QuasiStatic, low: float, high: float) -> None:
    """UserError unless enough targets of the direction lie inside the segment."""
    rows = (quasi.direction == record.direction) & (quasi.target >= low) & (quasi.target <= high)
    targets = np.unique(quasi.target[rows])
    if len(targets) < LEAST_TARGETS:
        raise UserError(
            f"{quasi.source}: {len(targets)} target{'s' * (len(targets) != 1)} {DIRECTION_NAMES[record.direction]} "
            f"from {low:.3f} to {high:.3f} mm, where {record.source} moves at constant velocity: at least "
            f"{LEAST_TARGETS} are needed to find its scale and datum"
        )
    if len(targets) == LEAST_TARGETS and quasi.u is None:
        raise UserError(
            f"{quasi.source}: two targets inside the segment do not show the noise of the readings; "
            "state it with '# u_um: ...' in the header"
        )


def _difference(courses: Sequence[Course], bare: Sequence[Array], i: int) -> Array | None:
    """Errors `(n,)` of a course minus the mean of the others of its direction, scaled to its own noise, um."""
    count = len(courses)
    if count < 2:
        return None
    x, error = courses[i].x, bare[i]
    others = []
    for k, (course, values) in enumerate(zip(courses, bare, strict=True)):
        if k != i:
            order = np.argsort(course.x)
            others.append(np.interp(x, course.x[order], values[order]))
    scaled = (x - x.mean()) / np.ptp(x)
    off = error - np.mean(others, axis=0)
    off = off - np.polyval(np.polyfit(scaled, off, 1), scaled)
    return np.asarray(off * np.sqrt((count - 1.0) / count))


def _waves(course: Course, shape: Shape) -> tuple[Wave, ...]:
    """Amplitudes of the waves; the uncertainty of a period is that of a single sine over the travel."""
    first, found = len(shape.extra.jumps), []
    covariance = shape.amount_covariance()
    length = shape.interval[1] - shape.interval[0]
    for k, period in enumerate(shape.extra.periods):
        part = slice(first + 2 * k, first + 2 * k + 2)
        amounts, own = shape.amounts[part], covariance[part, part]
        size = float(np.hypot(*amounts))
        u = float(np.sqrt(amounts @ own @ amounts)) / size
        u_period = period**2 / length * np.sqrt(6.0) / np.pi * u / size
        found.append(Wave(period, float(u_period), size, u, course.speed / period))
    return tuple(sorted(found, key=lambda wave: -wave.amplitude_um))


def _jumps(shape: Shape) -> Jumps:
    count = len(shape.extra.jumps)
    u = np.sqrt(np.diag(shape.amount_covariance())[:count])
    return Jumps(
        shape.extra.jumps,
        tuple(shape.amounts[:count].tolist()),
        tuple(u.tolist()),
        pitch_of(shape.extra.jumps, shape.grain),
    )


def _common(shapes: Mapping[int, Shape]) -> tuple[float, float]:
    return max(shape.interval[0] for shape in shapes.values()), min(shape.interval[1] for shape in shapes.values())


def _inside(shapes: Mapping[int, Shape], quasi: QuasiStatic) -> np.ndarray:
    """Mask `(m,)` of the readings within the segment of their direction, or of the other if theirs has no run."""
    inside = np.zeros(len(quasi), bool)
    for sign in DIRECTION_NAMES:
        low, high = shapes[sign].interval if sign in shapes else next(iter(shapes.values())).interval
        inside |= (quasi.direction == sign) & (quasi.target >= low) & (quasi.target <= high)
    return inside


def _positions(low: float, high: float, spacing: float | None) -> Array:
    """Positions of the table, mm: multiples of the spacing inside the segment, and both ends."""
    if spacing is None:
        requested = (high - low) / TABLE_ROWS
        decade = 10.0 ** np.floor(np.log10(requested))
        spacing = float(min((decade * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda each: abs(each - requested)))
    if (high - low) / spacing > MOST_TABLE_ROWS:
        raise UserError(
            f"--spacing-mm {spacing:g}: {(high - low) / spacing:.0f} rows over {high - low:.1f} mm, "
            f"more than {MOST_TABLE_ROWS}"
        )
    inside_segment = spacing * np.arange(np.ceil(low / spacing), np.floor(high / spacing) + 1.0)
    ends = [
        end for end in (low, high) if len(inside_segment) == 0 or np.abs(inside_segment - end).min() > 0.05 * spacing
    ]
    return np.sort(np.concatenate([np.round(inside_segment, 9), ends]))


def _direction(requested: Direction, by_direction: Mapping[int, OneDirection], found: Fused) -> str:
    """Direction of the table; UserError if the data do not contain it."""
    if requested == "auto":
        return "mean" if len(by_direction) == 2 else DIRECTION_NAMES[next(iter(by_direction))]
    needed = {1, -1} if requested == "mean" else {sign for sign, name in DIRECTION_NAMES.items() if name == requested}
    if not needed <= set(found.signs):
        there = ", ".join(DIRECTION_NAMES[sign] for sign in found.signs)
        raise UserError(f"--direction {requested}: the quasi-static readings have only {there}")
    return requested


def _outside(found: Fused, direction: str) -> tuple[Array, Array, Array]:
    """Targets, mm, errors and standard uncertainties, um, outside the segment.

    Mean and reversal are given at targets with readings in both directions.
    """
    nothing = (np.zeros(0), np.zeros(0), np.zeros(0))
    if direction in DIRECTION_NAMES.values():
        sign = next(sign for sign, name in DIRECTION_NAMES.items() if name == direction)
        return found.outside.get(sign, nothing)
    if set(found.outside) != {1, -1}:
        return nothing
    (x, up, u_up), (other, down, u_down) = found.outside[1], found.outside[-1]
    both, i, j = np.intersect1d(x, other, return_indices=True)
    half = 0.5 if direction == "mean" else 1.0
    value = half * (up[i] + down[j]) if direction == "mean" else up[i] - down[j]
    return both, value, half * np.hypot(u_up[i], u_down[j])


def _feed_notes(course: Course) -> list[str]:
    record, name = course.record, course.record.name
    notes = []
    if abs(course.feed / record.feed - 1.0) > FEED_OFF:
        notes.append(f"run {name} moved at {course.feed:.5g} mm/min, its header states {record.feed:g}")
    if course.dropped:
        notes.append(f"run {name}: {course.dropped} samples far from their neighbours are left out")
    if course.missing:
        notes.append(f"run {name}: {course.missing} samples are missing in the record")
    return notes


def _refuse_unexplained(quasi: QuasiStatic, inside: np.ndarray, found: Fused) -> None:
    """UserError if the continuous runs explain the quasi-static readings no better than straight lines.

    Only if the readings scatter by more than the instrument specification allows.
    """
    squares, free = 0.0, 0
    for sign in DIRECTION_NAMES:
        rows = inside & (quasi.direction == sign)
        if rows.sum() > LEAST_TARGETS:
            x, y = quasi.target[rows], quasi.deviation[rows]
            squares += float(np.sum((y - np.polyval(np.polyfit(x, y, 1), x)) ** 2))
            free += int(rows.sum()) - LEAST_TARGETS
    line = (squares / free) ** 0.5 if free else np.inf
    if found.spread.noise > max(AGREES * found.spread.specified, NO_BETTER * line):
        raise UserError(
            f"{quasi.source}: the readings scatter by {found.spread.noise:.3g} um about the error that the continuous "
            f"runs show, and by {line:.3g} um about a straight line: the runs do not explain them. Compare unit, sign "
            "and axis of deviation_um and displacement_mm, and look for steps in the runs; no table is written"
        )


def _noise_notes(found: Fused) -> list[str]:
    spread = found.spread
    if spread.specified and spread.noise > AGREES * spread.specified:
        return [
            f"quasi-static readings scatter by {spread.noise:.2g} um about the continuous curve, the instrument "
            f"specification gives {spread.specified:.2g} um: the axis repeats no better, or its motion differs from "
            "its standstill; u is increased accordingly"
        ]
    return []
