"""Chord error of corrected moves, and the cuts that keep the path on the control near the corrected path.

The control joins the corrected ends of a segment by a straight line in programmed coordinates, or by an arc. The
deviation from the corrected path is sampled, and bounded between two samples by second differences: a coordinate with
a curvature of one sign over three steps deviates from the straight line between two samples by at most (|second
difference at the one| + |at the other|) / 4, because it lies between that line and those of the neighbouring samples.
This includes the kinks of tables. The steps are a quarter of the shortest feature length of the model.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.columns import ChainColumns, minus, rows_of, vector
from kinematics.error_model.model import ErrorModel
from kinematics.machine import NDArrayBool
from kinematics.second_differences import SecondDifferences
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import corrected_positions
from postproc.compensation.datum import datum_shifts
from postproc.motion.along import positions_along, round_the_circle
from postproc.motion.circles import middle_share, moved_centre
from postproc.motion.frames import Frame, cartesian
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind
from postproc.motion.reversals import needs_direction
from postproc.motion.segments import arc_ends, arc_turned, part_of

CHORD_STEPS = 8
"""Smallest number of steps in which a segment is evaluated."""
MOST_CHORD_STEPS = 8192
BATCH = 100_000
"""Number of samples that are evaluated together."""
JUMP_STEPS = 10
"""Number of bisections to find the jump of the error in a segment."""
SHORTEST_SEGMENT_MM, SHORTEST_SEGMENT_DEG = 0.2, 0.05
"""Shortest length of a segment: no continuous path can follow a jump of the error."""


class CorrectedPaths(msgspec.Struct, frozen=True, dict=True):
    """Corrected paths of a chunk of moves, at any position along them."""

    motions: Motions
    models: tuple[ErrorModel, ErrorModel | None]
    """Models of the tool point and, if it is corrected, of the orientation."""
    conditions: Conditions

    def shifts(self, rows: np.ndarray, shares: Array) -> Array:
        """Corrected minus nominal programmed positions `(k, axes)` at shares `(k,)` of the paths of rows `(k,)`."""
        program, bare = positions_along(self.motions, rows, shares), self._bare.take(rows)
        states = self.conditions.states(None if self._heading is None else self._heading[rows])
        machine, movable = self.motions.machine, self._movable[rows]
        corrected = corrected_positions(
            machine, self.models, states, bare.in_machine(program), bare.tool, movable, self._datum[rows]
        )
        return np.asarray(bare.in_program(corrected) - program)

    def tool_point_errors(self, rows: np.ndarray, shares: Array) -> Array:
        """Tool point errors `(k, 3)` of the uncorrected machine, mm: approximately minus the shifts.

        In the workpiece frame; where rotary axes turn without TCP, along the linear axes.
        """
        bare, machine = self._bare.take(rows), self.motions.machine
        q = bare.in_machine(positions_along(self.motions, rows, shares))
        states = self.conditions.states(None if self._heading is None else self._heading[rows])
        chain, tip = ChainColumns(machine, q), vector(bare.tool)
        apart = minus(chain.point(tip, states.errors(machine, self.models[0])(q)), chain.point(tip))
        errors = minus(apart, vector(self._datum[rows]))
        along, turned = chain.linear_steps(errors), self.turned[rows]
        x, y, z = (np.where(turned, there, here) for there, here in zip(along, errors, strict=True))
        return rows_of((x, y, z), len(rows))

    def second_difference_bounds(self, rows: np.ndarray, least: float) -> Array:
        """Upper bounds `(k,)`, mm, of |e(0) - 2 e(1/2) + e(1)| with the `tool_point_errors` e of straight moves.

        rows `(k,)`: different ones, in their order.
        least: smallest bound, mm, that is returned.
        """
        motions = self.motions
        bounds = SecondDifferences(self.conditions.errors(motions.machine, self.models[0])).bounds
        some = rows if len(rows) < len(motions) else slice(None)  # without copies
        moves = self._starts[some], motions.machine_target[some], motions.tool[some]
        return bounds(*moves, motions.tcp[some], self.turned[some], self._datum[some], least)

    @cached_property
    def turned(self) -> NDArrayBool:
        """True `(n,)` for moves along which rotary axes turn without TCP."""
        return np.asarray((self.extents[:, self.motions.machine.rotary] > 0.0).any(axis=1) & ~self.motions.tcp)

    @cached_property
    def weights(self) -> Array:
        """Largest displacement of the tool per programmed displacement `(n, axes)`, mm per mm or degree."""
        frames = [self._weights_in(frame) for frame in self.motions.frames]
        return np.asarray(np.array(frames)[self.motions.frame])

    def _weights_in(self, frame: Frame) -> Array:
        machine = self.motions.machine
        weights = np.where(machine.rotary, 0.0, 1.0)
        if frame.turn is not None:
            weights[list(cartesian(machine))] = np.linalg.norm(np.reshape(frame.turn, (3, 3)), 2)
        if self.models[1] is not None and not frame.tcp:
            reach = np.linalg.norm(np.abs(machine.travel).max(axis=0)[~machine.rotary]) + frame.tool_length
            reach += max(float(np.linalg.norm(axis.point)) for axis in machine.axes)
            weights[machine.rotary] = np.deg2rad(reach)
        return weights

    @cached_property
    def extents(self) -> Array:
        """Upper bound of the travel of the axes along the moves `(n, axes)`, mm and rad, except for rounding."""
        motions, machine = self.motions, self.motions.machine
        extents, linear = np.abs(motions.machine_target - self._starts), ~machine.rotary
        curved = motions.coupled.copy()
        curved[list(motions.arcs)] = True
        if curved.any():
            lengths = np.linalg.norm((motions.target - motions.start)[:, linear], axis=1)
            if motions.arcs:
                lengths[motions.circles.rows] += motions.circles.lengths
            extents[np.ix_(curved, linear)] += lengths[curved, None]
        return np.asarray(extents)

    @cached_property
    def steps(self) -> Array:
        """Number of steps `(n,)`, not rounded, in which a move must be evaluated so that no feature is errors."""
        steps = 4.0 * (self.extents / self.models[0].feature_lengths(self.motions.machine)).max(axis=1, initial=0.0)
        if self.motions.arcs:
            circles = self.motions.circles
            rows = circles.rows[circles.turns > 0]
            steps[rows] = np.maximum(steps[rows], CHORD_STEPS * np.abs(circles.turned[circles.turns > 0]) / math.pi)
        return np.asarray(steps)

    @cached_property
    def shortest(self) -> Array:
        """Smallest share `(n,)` of the path of a move that a segment may have."""
        linear = ~self.motions.machine.rotary
        mm = self.extents[:, linear].max(axis=1, initial=0.0)
        degrees = np.rad2deg(self.extents[:, ~linear].max(axis=1, initial=0.0))
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum(SHORTEST_SEGMENT_MM / mm, SHORTEST_SEGMENT_DEG / degrees))

    @cached_property
    def _starts(self) -> Array:
        """Axis positions `(n, axes)`, mm and rad, at the starts of the moves."""
        return self.motions.in_machine(self.motions.start)

    @cached_property
    def _datum(self) -> Array:
        """Displacement of the part from its nominal position `(n, 3)`, mm, workpiece frame."""
        return datum_shifts(self.motions, self.models[0], self.conditions)

    @cached_property
    def _bare(self) -> Motions:
        return self.motions.bare

    @cached_property
    def _movable(self) -> NDArrayBool:
        return self.motions.movable

    @cached_property
    def _heading(self) -> Array | None:
        """Directions along straight moves `(n, axes)`; 0, the middle of the backlash, on arcs and under TCP."""
        if not any(needs_direction(effect) for model in self.models if model is not None for effect in model.effects):
            return None
        motions = self.motions
        heading = np.sign(motions.machine_target - self._starts)
        heading[motions.tcp | (motions.kind != Kind.LINE)] = 0.0
        return np.asarray(heading)


class Limits(NamedTuple):
    """Limits of the deviation of a move from its corrected path: a tolerance, and the error of the input."""

    tolerance: float
    """Largest deviation, mm."""
    rounding: float
    """Excess, mm, of the deviation over the error in the input; infinite if a move may be worse than in the input."""

    def of(self, errors: Array) -> Array:
        """Limits, mm, of moves with these largest errors in the input, mm, of any shape."""
        return np.minimum(errors + self.rounding, self.tolerance)


class Segment(NamedTuple):
    """Segment of a move, by shares of its path."""

    row: int
    low: float
    high: float


class Sampled(NamedTuple):
    """A segment with the shifts along it."""

    segment: Segment
    shifts: Array
    """`(steps + 1, axes)`, mm and degrees."""
    largest: float
    """Largest displacement of the tool by them, mm."""


class Cuts(NamedTuple):
    """Cuts of moves."""

    shares: dict[int, list[float]]
    """Shares of the cuts by row; rows that need no cut are left out."""
    steep: list[Segment]
    """Segments of the shortest length that deviate by more than their limits."""


def find_cuts(paths: CorrectedPaths, rows: np.ndarray, limits: Limits) -> Cuts:
    """Cuts of rows `(k,)` so that all segments stay within their limits.

    Segments are halved, so that all shares are sums of powers of 1/2.
    """
    found = Cuts(defaultdict(list), [])
    most: dict[int, float] = {}
    segments = [Segment(row, 0.0, 1.0) for row in rows.tolist()]
    while segments:
        following: list[Segment] = []
        for some in _batches(paths, segments):
            for each in some:
                if each.segment.row not in most:  # the whole move
                    most[each.segment.row] = each.largest + limits.rounding
            _cut(paths, some, limits.tolerance, most, found, following)
        segments = following
    _cross_jumps(paths, found, limits)
    return found._replace(shares={row: sorted(shares) for row, shares in sorted(found.shares.items()) if shares})


def _cross_jumps(paths: CorrectedPaths, found: Cuts, limits: Limits) -> None:
    """Move the cuts of steep segments so that the error jumps in the middle of a segment of the shortest length.

    A straight line across the middle of a jump deviates by half of the jump on either side; on one side the error of
    the input is at least as large.
    """
    if not found.steep or math.isinf(limits.rounding):
        return
    found.steep.sort()
    rows, low, high = (np.array(column) for column in zip(*found.steep, strict=True))
    before, after = paths.tool_point_errors(rows, low), paths.tool_point_errors(rows, high)
    whole = np.linalg.norm(after - before, axis=1)
    for _ in range(JUMP_STEPS):
        middle = (low + high) / 2
        there = paths.tool_point_errors(rows, middle)
        first = np.linalg.norm(there - before, axis=1) > np.linalg.norm(after - there, axis=1)
        low, high = np.where(first, low, middle), np.where(first, middle, high)
        before = np.where(first[:, None], before, there)
        after = np.where(first[:, None], there, after)
    jumps = np.linalg.norm(after - before, axis=1) > whole / 4
    for row, jump in zip(rows[jumps].tolist(), ((low + high) / 2)[jumps].tolist(), strict=True):
        _cross(found.shares[row], jump, float(paths.shortest[row]))


def _cross(shares: list[float], jump: float, length: float) -> None:
    """Replace the cuts near the share `jump` by a segment of this length about it, if the move has room for it."""
    half = min(length / 2, jump, 1.0 - jump)
    if half < length / 20:
        return
    grid = 2.0 ** math.ceil(math.log2(64.0 / half))
    shares[:] = [share for share in shares if abs(share - jump) > half + length]
    shares += [end for share in (jump - half, jump + half) if 0.0 < (end := round(share * grid) / grid) < 1.0]


def _batches(paths: CorrectedPaths, segments: list[Segment]) -> Iterator[list[Sampled]]:
    """The segments with the shifts along them, in batches."""
    rows, low, high = (np.array(column) for column in zip(*segments, strict=True))
    aim = np.maximum(paths.steps[rows] * (high - low) / CHORD_STEPS, 1.0)
    steps = np.minimum(CHORD_STEPS * 2 ** np.ceil(np.log2(aim)), MOST_CHORD_STEPS).astype(int)
    ends = np.cumsum(steps + 1)
    for batch in np.split(np.arange(len(segments)), np.flatnonzero(np.diff(ends // BATCH)) + 1):
        counts = steps[batch] + 1
        firsts = np.cumsum(counts) - counts
        inner = (np.arange(counts.sum()) - np.repeat(firsts, counts)) / np.repeat(steps[batch], counts)
        shares = np.repeat(low[batch], counts) + inner * np.repeat(high[batch] - low[batch], counts)
        row = np.repeat(rows[batch], counts)
        shifts = paths.shifts(row, shares)
        largest = np.maximum.reduceat(np.linalg.norm(shifts * paths.weights[row], axis=1), firsts).tolist()
        parts = zip(batch.tolist(), np.split(shifts, firsts[1:]), largest, strict=True)
        yield [Sampled(segments[i], part, most) for i, part, most in parts]


def _cut(
    paths: CorrectedPaths,
    some: list[Sampled],
    tolerance: float,
    most: Mapping[int, float],
    found: Cuts,
    following: list[Segment],
) -> None:
    """Halve segments as often as their limits require: a tolerance, and those of their rows, mm.

    `found` takes the cuts, `following` the segments that need finer steps.
    """
    open_parts = [(each.segment, each.shifts) for each in some]
    while open_parts:
        parts, open_parts = sorted(open_parts, key=lambda part: len(part[1])), []
        for samples, group in groupby(parts, key=lambda part: len(part[1])):
            alike, steps = list(group), samples - 1
            for (inside, shifts), bound, deviation in zip(alike, *deviations(paths, alike), strict=True):
                row, low, high = inside
                if bound <= tolerance and deviation <= most[row]:
                    continue
                if high - low < 2.0 * paths.shortest[row]:
                    found.steep.append(inside)
                    continue
                middle = steps // 2
                cut = low + (high - low) * middle / steps
                found.shares[row].append(cut)
                halves = Segment(row, low, cut), Segment(row, cut, high)
                if steps >= 2 * CHORD_STEPS:
                    open_parts += [(halves[0], shifts[: middle + 1]), (halves[1], shifts[middle:])]
                else:
                    following += halves


def deviations(paths: CorrectedPaths, alike: list[tuple[Segment, Array]]) -> tuple[list[float], list[float]]:
    """Deviations of the control along segments with corrected ends, mm, each with shifts `(steps + 1, axes)`.

    All have the same number of steps. First upper bounds, then the deviations for a uniform curvature between two
    samples.
    """
    shifts = np.stack([each for _, each in alike])
    even = np.linspace(0.0, 1.0, shifts.shape[1])[:, None]
    deviation = (1.0 - even) * shifts[:, :1] + even * shifts[:, -1:] - shifts
    rows = [segment.row for segment, _ in alike]
    for k, (segment, own) in enumerate(alike) if paths.motions.arcs else ():
        arc = paths.motions.arcs.get(segment.row)
        if arc is not None:
            i, j, _ = arc.plane
            plane = _arc_deviation(paths.motions, segment, arc, own[:, i] + 1j * own[:, j])
            deviation[k, :, i], deviation[k, :, j] = plane.real, plane.imag
    deviation *= paths.weights[rows][:, None]
    curvature = np.linalg.norm(np.diff(deviation, 2, axis=1), axis=2)
    # an end has no second difference of its own
    curvature = np.concatenate([3.0 * curvature[:, :1], curvature, 3.0 * curvature[:, -1:]], axis=1)
    sizes = np.linalg.norm(deviation, axis=2)
    sizes, curvature = np.maximum(sizes[:, :-1], sizes[:, 1:]), curvature[:, :-1] + curvature[:, 1:]
    bounds, uniform = ((sizes + curvature / share).max(axis=1).tolist() for share in (4.0, 16.0))
    return bounds, uniform


def _arc_deviation(motions: Motions, segment: Segment, arc: Arc, shifts: np.ndarray) -> np.ndarray:
    """Complex deviations `(steps + 1,)` of the corrected arc of a segment from the corrected path; shifts likewise."""
    start, end = (complex(*point) for point in arc_ends(motions, segment.row))
    turned = arc_turned(motions, segment.row) * (segment.high - segment.low)
    even = np.linspace(0.0, 1.0, len(shifts))
    nominal = round_the_circle(arc, (start, end), segment.low + even * (segment.high - segment.low))
    first, last = nominal[0], nominal[-1]
    middle = shifts[round(middle_share(turned) * (len(shifts) - 1))]
    moved = [(float(s.real), float(s.imag)) for s in (shifts[0], middle, shifts[-1])]
    ends = (first.real, first.imag), (last.real, last.imag)
    part = part_of(arc, ends, turned)
    full = part.full
    written = part._replace(centre=moved_centre(ends, arc.centre, turned, (moved[0], moved[1], moved[2])))
    corrected = first + shifts[0], first + shifts[0] if full else last + shifts[-1]
    return np.asarray(round_the_circle(written, corrected, even) - nominal - shifts)


def beyond_limits(paths: CorrectedPaths, rows: np.ndarray, limits: Limits, bounds: Array) -> np.ndarray:
    """Rows of `rows` `(k,)` that may exceed their limits in one segment, by a fast test on uncorrected errors.

    A straight move is tested by the second difference of the errors at its start, middle and end: by an upper bound,
    `bounds` `(rows,)`, and where that exceeds the limit by the errors themselves. Rows that need a closer evaluation
    are included.
    """
    motions = paths.motions
    close = (paths.models[1] is not None) | (paths.steps[rows] > 2.0)
    arcs = motions.kind[rows] == Kind.ARC
    flat = np.zeros(len(rows), bool)
    lines = np.flatnonzero(~close & ~arcs)
    flat[lines] = 1.5 * bounds[lines] <= limits.of(np.zeros(len(lines)))
    lines = lines[~flat[lines]]
    before, middle, after = errors = _errors_at(paths, rows[lines], (0.0, 0.5, 1.0))
    flat[lines] = 1.5 * np.linalg.norm(before - 2.0 * middle + after, axis=1) <= limits.of(_largest(errors))
    circles = np.flatnonzero(~close & arcs)
    first, *others = errors = _errors_at(paths, rows[circles], (0.0, 0.25, 0.5, 0.75, 1.0))
    flat[circles] = _largest([other - first for other in others]) <= limits.of(_largest(errors)) / 3.0
    return rows[~flat]


def _largest(vectors: list[Array]) -> Array:
    """Largest length `(n,)` of several vectors `(n, 3)` each."""
    return np.asarray(np.max([np.linalg.norm(vector, axis=1) for vector in vectors], axis=0))


def _errors_at(paths: CorrectedPaths, rows: np.ndarray, shares: tuple[float, ...]) -> list[Array]:
    """Tool point errors `(n, 3)`, mm, as of `tool_point_errors`, at each share of all rows."""
    each = len(shares)
    found = (
        paths.tool_point_errors(np.repeat(rows, each), np.tile(shares, len(rows))) if len(rows) else np.empty((0, 3))
    )
    return [found[i::each] for i in range(each)]
