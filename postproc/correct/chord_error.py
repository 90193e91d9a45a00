"""How the correction bends along moves, and where they are cut so that the control stays beside the corrected path.

The control joins the corrected ends of a piece by a straight line in programmed coordinates, or by an arc. What that
leaves is sampled, and between two samples bounded by second differences: a coordinate that bends one way over three
steps strays from the straight line between two samples by no more than (|second difference at the one| + |at the
other|) / 4, for it lies between that line and those of its neighbours, kinks of tables included. The steps are a
quarter of the shortest way on which errors of the model bend there and back.
"""

from __future__ import annotations

import math
import operator
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import corrected_positions
from postproc.compensation.datum import datum_shifts
from postproc.motion.along import places, round_the_circle
from postproc.motion.circles import middle_share, moved_centre
from postproc.motion.frames import Frame, cartesian
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind
from postproc.motion.reversals import needs_direction
from postproc.motion.segments import arc_ends, arc_turned, part_of

STEPS = 8
"""Fewest steps that a piece is looked at in."""
MOST_STEPS = 8192
BATCH = 100_000
"""Samples worked out together."""
JUMP_STEPS = 10
"""How often a piece is halved to find where its error jumps."""
SHORTEST_MM, SHORTEST_DEG = 0.2, 0.05
"""No piece is cut shorter: where errors jump, no path that hangs together can follow."""


@dataclass(frozen=True)
class CorrectedWays:
    """Where the corrected paths of a chunk of moves lead, at any place along them."""

    motions: Motions
    models: tuple[ErrorModel, ErrorModel | None]
    """Of the tool point, and where it is corrected of the orientation."""
    conditions: Conditions

    def shifts(self, rows: np.ndarray, shares: Array) -> Array:
        """Corrected minus nominal programmed positions `(k, axes)` at shares `(k,)` of the ways of rows `(k,)`."""
        program, bare = places(self.motions, rows, shares), self._bare.take(rows)
        states = self.conditions.states(None if self._heading is None else self._heading[rows])
        machine, movable = self.motions.machine, self._movable[rows]
        corrected = corrected_positions(
            machine, self.models, states, bare.in_machine(program), bare.tool, movable, self._datum[rows]
        )
        return np.asarray(bare.in_program(corrected) - program)

    def misses(self, rows: np.ndarray, shares: Array) -> Array:
        """What the uncorrected machine misses `(k, 3)`, mm: minus the shifts, nearly.

        In the workpiece frame; along the axes that place the tool where rotary axes turn without TCP.
        """
        bare, machine = self._bare.take(rows), self.motions.machine
        q = bare.in_machine(places(self.motions, rows, shares))
        states = self.conditions.states(None if self._heading is None else self._heading[rows])
        wanted = tool_point(machine, q, bare.tool)
        missed = tool_point(machine, q, bare.tool, self.models[0].errors(machine, states(q))) - wanted
        missed -= self._datum[rows]
        turned = self.turned[rows]
        if turned.any():
            there = linear_positions(machine, q[turned], wanted[turned] + missed[turned], bare.tool[turned])
            missed[turned] = (there - q[turned])[:, machine.translators]
        return np.asarray(missed)

    @cached_property
    def turned(self) -> NDArrayBool:
        """Moves `(n,)` along which rotary axes turn without TCP."""
        tcp = np.array([frame.tcp for frame in self.motions.frames], bool)[self.motions.frame]
        return np.asarray((self.extents[:, self.motions.machine.rotary] > 0.0).any(axis=1) & ~tcp)

    @cached_property
    def weights(self) -> Array:
        """What a difference of programmed positions counts at the tool `(n, axes)`, mm per mm or degree; at most."""
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
        """How far the axes go along the moves `(n, axes)`, mm and rad; at most, but for what rounding adds."""
        motions, machine = self.motions, self.motions.machine
        way = np.abs(motions.target - motions.start)
        extents = np.abs(motions.machine_target - motions.in_machine(motions.start))
        linear = ~machine.rotary
        lengths = np.linalg.norm(way[:, linear], axis=1)
        for row in motions.arcs:
            lengths[row] += way_round(motions, row)
        curved = motions.coupled
        curved[list(motions.arcs)] = True
        extents[np.ix_(curved, linear)] += lengths[curved, None]
        return np.asarray(extents)

    @cached_property
    def steps(self) -> Array:
        """In how many steps `(n,)`, not whole, a move has to be looked at so that no bend is missed."""
        steps = 4.0 * (self.extents / self.models[0].feature_lengths(self.motions.machine)).max(axis=1, initial=0.0)
        for row in self.motions.arcs:
            if self.motions.arcs[row].turns:
                steps[row] = max(steps[row], STEPS * abs(arc_turned(self.motions, row)) / math.pi)
        return np.asarray(steps)

    @cached_property
    def shortest(self) -> Array:
        """Share `(n,)` of the way of a move under which it is not cut."""
        linear = ~self.motions.machine.rotary
        mm = self.extents[:, linear].max(axis=1, initial=0.0)
        degrees = np.rad2deg(self.extents[:, ~linear].max(axis=1, initial=0.0))
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum(SHORTEST_MM / mm, SHORTEST_DEG / degrees))

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
        """Which way axes go along straight moves `(n, axes)`; round arcs and under TCP, amid their play."""
        if not any(needs_direction(effect) for model in self.models if model is not None for effect in model.effects):
            return None
        motions = self.motions
        heading = np.sign(motions.machine_target - motions.in_machine(motions.start))
        tcp = np.array([frame.tcp for frame in motions.frames], bool)[motions.frame]
        heading[tcp | (motions.kind != Kind.LINE)] = 0.0
        return np.asarray(heading)


def way_round(motions: Motions, row: int) -> float:
    """Length of an arc in its plane, mm."""
    start, _ = arc_ends(motions, row)
    return math.dist(start, motions.arcs[row].centre) * abs(arc_turned(motions, row))


class Limits(NamedTuple):
    """How far a move may stray from its corrected path: not beyond a tolerance, and no farther than the input errs."""

    tolerance: float
    """mm."""
    rounding: float
    """mm, by which a move may stray farther than it errs in the input; infinite where that does not matter."""

    def of(self, errors: Array) -> Array:
        """The limits, mm, of moves with these largest errors in the input, mm, of any shape."""
        return np.minimum(errors + self.rounding, self.tolerance)


class _Piece(NamedTuple):
    """A part of the way of a move."""

    row: int
    low: float
    high: float


class Cuts(NamedTuple):
    """Where moves are cut."""

    shares: dict[int, list[float]]
    """Shares of the cuts by row; rows that need no cut are left out."""
    steep: list[_Piece]
    """Pieces at the shortest length that stray farther than they may."""


def find_cuts(ways: CorrectedWays, rows: np.ndarray, limits: Limits) -> Cuts:
    """Where to cut some rows so that all pieces stay within their limits.

    By halves, so that shares are sums of powers of 1/2.
    """
    found = Cuts(defaultdict(list), [])
    most: dict[int, float] = {}
    pieces = [_Piece(row, 0.0, 1.0) for row in rows.tolist()]
    while pieces:
        following: list[_Piece] = []
        for some in _batches(ways, pieces):
            for piece, shifts in some:
                row = piece.row
                if row not in most:  # the whole move
                    most[row] = float(np.linalg.norm(shifts * ways.weights[row], axis=1).max()) + limits.rounding
                _cut(ways, piece, shifts, (limits.tolerance, most[row]), found, following)
        pieces = following
    _cross_jumps(ways, found, limits)
    return found._replace(shares={row: sorted(shares) for row, shares in sorted(found.shares.items()) if shares})


def _cross_jumps(ways: CorrectedWays, found: Cuts, limits: Limits) -> None:
    """Move the cuts of steep pieces so that the error jumps in the middle of one of the shortest length.

    A straight line over the middle of a jump misses it by half of it on either side, and so does the input on one.
    """
    if not found.steep or math.isinf(limits.rounding):
        return
    found.steep.sort()
    rows, low, high = (np.array(column) for column in zip(*found.steep, strict=True))
    before, after = ways.misses(rows, low), ways.misses(rows, high)
    whole = np.linalg.norm(after - before, axis=1)
    for _ in range(JUMP_STEPS):
        middle = (low + high) / 2
        there = ways.misses(rows, middle)
        first = np.linalg.norm(there - before, axis=1) > np.linalg.norm(after - there, axis=1)
        low, high = np.where(first, low, middle), np.where(first, middle, high)
        before = np.where(first[:, None], before, there)
        after = np.where(first[:, None], there, after)
    jumps = np.linalg.norm(after - before, axis=1) > whole / 4
    for row, place in zip(rows[jumps].tolist(), ((low + high) / 2)[jumps].tolist(), strict=True):
        _cross(found.shares[row], place, float(ways.shortest[row]))


def _cross(shares: list[float], place: float, length: float) -> None:
    """Make a piece of this length about a place the only one near, where the move leaves so much room for it."""
    half = min(length / 2, place, 1.0 - place)
    if half < length / 20:
        return
    grid = 2.0 ** math.ceil(math.log2(64.0 / half))
    shares[:] = [share for share in shares if abs(share - place) > half + length]
    shares += [end for share in (place - half, place + half) if 0.0 < (end := round(share * grid) / grid) < 1.0]


def _batches(ways: CorrectedWays, pieces: list[_Piece]) -> Iterator[list[tuple[_Piece, Array]]]:
    """The pieces with the shifts `(steps + 1, axes)` along them, some at a time."""
    rows, low, high = (np.array(column) for column in zip(*pieces, strict=True))
    wanted = np.maximum(ways.steps[rows] * (high - low) / STEPS, 1.0)
    steps = np.minimum(STEPS * 2 ** np.ceil(np.log2(wanted)), MOST_STEPS).astype(int)
    ends = np.cumsum(steps + 1)
    for batch in np.split(np.arange(len(pieces)), np.flatnonzero(np.diff(ends // BATCH)) + 1):
        counts = steps[batch] + 1
        firsts = np.cumsum(counts) - counts
        inner = (np.arange(counts.sum()) - np.repeat(firsts, counts)) / np.repeat(steps[batch], counts)
        shares = np.repeat(low[batch], counts) + inner * np.repeat(high[batch] - low[batch], counts)
        shifts = ways.shifts(np.repeat(rows[batch], counts), shares)
        yield [(pieces[i], part) for i, part in zip(batch.tolist(), np.split(shifts, firsts[1:]), strict=True)]


def _cut(
    ways: CorrectedWays,
    piece: _Piece,
    shifts: Array,
    limits: tuple[float, float],
    found: Cuts,
    following: list[_Piece],
) -> None:
    """Halve a piece, with shifts `(steps + 1, axes)`, as often as need be; `following` takes what needs finer steps.

    limits: mm, as `strays` has them.
    """
    steps = len(shifts) - 1
    row, low, length = piece.row, piece.low, piece.high - piece.low
    open_ends = [(0, steps)]
    while open_ends:
        first, last = open_ends.pop()
        inside = _Piece(row, low + length * first / steps, low + length * last / steps)
        if all(map(operator.le, strays(ways, inside, shifts[first : last + 1]), limits)):
            continue
        if inside.high - inside.low < 2.0 * ways.shortest[row]:
            found.steep.append(inside)
            continue
        middle = (first + last) // 2
        cut = low + length * middle / steps
        found.shares[row].append(cut)
        if last - first >= 2 * STEPS:
            open_ends += [(first, middle), (middle, last)]
        else:
            following += [_Piece(row, inside.low, cut), _Piece(row, cut, inside.high)]


def strays(ways: CorrectedWays, piece: _Piece, shifts: Array) -> tuple[float, float]:
    """How far the control strays along a piece with corrected ends, mm; shifts `(steps + 1, axes)` on it.

    At most; and as far as an even bend between two places that are looked at explains.
    """
    even = np.linspace(0.0, 1.0, len(shifts))[:, None]
    rest = (1.0 - even) * shifts[0] + even * shifts[-1] - shifts
    arc = ways.motions.arcs.get(piece.row)
    if arc is not None:
        i, j, _ = arc.plane
        plane = _arc_rest(ways.motions, piece, arc, shifts[:, i] + 1j * shifts[:, j])
        rest[:, i], rest[:, j] = plane.real, plane.imag
    rest *= ways.weights[piece.row]
    bends = np.linalg.norm(np.diff(rest, 2, axis=0), axis=1)
    bends = np.concatenate([3.0 * bends[:1], bends, 3.0 * bends[-1:]])  # it may bend beside an end, with none beyond
    sizes = np.linalg.norm(rest, axis=1)
    sizes, bends = np.maximum(sizes[:-1], sizes[1:]), bends[:-1] + bends[1:]
    return float((sizes + bends / 4.0).max()), float((sizes + bends / 16.0).max())


def _arc_rest(motions: Motions, piece: _Piece, arc: Arc, shifts: np.ndarray) -> np.ndarray:
    """What the corrected arc of a piece misses of the corrected path `(steps + 1,)`, in the plane; shifts likewise."""
    start, end = (complex(*point) for point in arc_ends(motions, piece.row))
    turned = arc_turned(motions, piece.row) * (piece.high - piece.low)
    even = np.linspace(0.0, 1.0, len(shifts))
    nominal = round_the_circle(arc, (start, end), piece.low + even * (piece.high - piece.low))
    first, last = nominal[0], nominal[-1]
    middle = shifts[round(middle_share(turned) * (len(shifts) - 1))]
    moved = [(float(s.real), float(s.imag)) for s in (shifts[0], middle, shifts[-1])]
    ends = (first.real, first.imag), (last.real, last.imag)
    part = part_of(arc, ends, turned)
    full = part.full
    written = part._replace(centre=moved_centre(ends, arc.centre, turned, (moved[0], moved[1], moved[2])))
    corrected = first + shifts[0], first + shifts[0] if full else last + shifts[-1]
    return np.asarray(round_the_circle(written, corrected, even) - nominal - shifts)


def bent(ways: CorrectedWays, rows: np.ndarray, limits: Limits) -> np.ndarray:
    """Those of some rows that may stray farther than their limits in one piece; quickly, by uncorrected errors.

    Of straight moves by the error in the middle; a row that has to be looked at more closely is among them.
    """
    motions = ways.motions
    close = (ways.models[1] is not None) | (ways.steps[rows] > 2.0)
    arcs = motions.kind[rows] == Kind.ARC
    flat = np.zeros(len(rows), bool)
    lines = np.flatnonzero(~close & ~arcs)
    before, middle, after = errors = _looked_at(ways, rows[lines], (0.0, 0.5, 1.0))
    flat[lines] = 1.5 * np.linalg.norm(before - 2.0 * middle + after, axis=1) <= limits.of(_largest(errors))
    circles = np.flatnonzero(~close & arcs)
    first, *others = errors = _looked_at(ways, rows[circles], (0.0, 0.25, 0.5, 0.75, 1.0))
    flat[circles] = _largest([other - first for other in others]) <= limits.of(_largest(errors)) / 3.0
    return rows[~flat]


def _largest(vectors: list[Array]) -> Array:
    """Largest length `(n,)` of several vectors `(n, 3)` each."""
    return np.asarray(np.max([np.linalg.norm(vector, axis=1) for vector in vectors], axis=0))


def _looked_at(ways: CorrectedWays, rows: np.ndarray, shares: tuple[float, ...]) -> list[Array]:
    """Misses `(n, 3)` at each of some shares of all rows."""
    each = len(shares)
    found = ways.misses(np.repeat(rows, each), np.tile(shares, len(rows))) if len(rows) else np.empty((0, 3))
    return [found[i::each] for i in range(each)]
