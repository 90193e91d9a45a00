"""Rows in addition to those of the program: segments of moves, and backlash take-ups before moves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.along import positions_along
from postproc.motion.circles import Point, crossings, same, sweep
from postproc.motion.frames import cartesian
from postproc.motion.motions import BY_ROW, Motions
from postproc.motion.moves import Arc, Kind, Known

NEARLY_A_TURN = 2 * math.pi - 1e-3
"""Sweep of an arc that is nearly a full circle, rad."""
LARGEST_SHARE_DENOMINATOR = 1 << 20
"""Largest denominator of a share."""


def arc_ends(motions: Motions, row: int) -> tuple[Point, Point]:
    """Start and end of an arc in its plane, programmed coordinates, mm."""
    i, j, _ = motions.arcs[row].plane
    start, end = motions.start[row].tolist(), motions.target[row].tolist()
    return (start[i], start[j]), (end[i], end[j])


def arc_turned(motions: Motions, row: int) -> float:
    """Sweep of an arc, rad, positive counter-clockwise."""
    arc = motions.arcs[row]
    return sweep(*arc_ends(motions, row), arc.centre, arc.sense, arc.full, arc.turns)


def turning_points(motions: Motions, row: int) -> Iterator[tuple[float, int, float]]:
    """Reversals of axes within an arc, in the order of the motion.

    Each has the share of the arc, the column of the axis, and the smaller of its travels before and after, mm.
    """
    arc, (start, _), turned = motions.arcs[row], arc_ends(motions, row), arc_turned(motions, row)
    radius, found = math.dist(start, arc.centre), []
    for axis, (x, y) in _directions_in_plane(motions, row):
        for share in crossings(start, arc.centre, turned, math.atan2(y, x)):
            nearer = min(share, 1.0 - share) * abs(turned)
            found.append((share, axis, math.hypot(x, y) * radius * (1.0 - math.cos(min(nearer, math.pi)))))
    yield from sorted(found)


def _directions_in_plane(motions: Motions, row: int) -> list[tuple[int, Point]]:
    """Machine axes that an arc moves, each with its direction in the plane of the arc, mm per programmed mm."""
    arc, x_y_z, frame = motions.arcs[row], cartesian(motions.machine), motions.frames[motions.frame[row]]
    if not frame.couples:
        return [(arc.plane[0], (1.0, 0.0)), (arc.plane[1], (0.0, 1.0))]
    i, j = (x_y_z.index(axis) for axis in arc.plane[:2])
    turn = np.reshape(frame.turn or (), (3, 3)).tolist()
    return [(axis, (line[i], line[j])) for axis, line in zip(x_y_z, turn, strict=True) if line[i] or line[j]]


def split(motions: Motions, cuts: Mapping[int, Sequence[float]], *, at_quadrants: bool = False) -> Motions:
    """The moves, some of them cut into segments at shares of their paths; `cuts`: these shares, by row.

    The first segment keeps the block; the others are `added`, and name no axis. Segments may be cut again.
    `at_quadrants`: the added segments get no start fraction, because it follows from the quadrants of the circle.
    """
    if not cuts:
        return motions
    pieces = np.ones(len(motions), int)
    pieces[list(cuts)] += [len(shares) for shares in cuts.values()]
    result = motions.take(np.repeat(np.arange(len(motions)), pieces))
    first = np.cumsum(pieces) - pieces
    later = np.ones(len(result), bool)
    later[first] = False
    rows = np.repeat(np.arange(len(motions)), pieces - 1)
    shares = np.array([share for row in sorted(cuts) for share in cuts[row]], float)
    added = np.flatnonzero(later)
    start, target, start_fraction, known_start = result.copies("start", "target", "start_fraction", "known_start")
    start[added] = target[added - 1] = positions_along(motions, rows, shares)
    start_fraction[added] = np.nan if at_quadrants else _of_whole_moves(motions, rows, shares)
    known_start[added] = motions.known[rows]
    result = replace(
        result,
        start=start,
        target=target,
        start_fraction=start_fraction,
        known_start=known_start,
        added=result.added | later,
        frame_unchanged=result.frame_unchanged | later,
        words=result.words.without(later),
    )
    arcs = dict(result.arcs)
    for row in cuts.keys() & motions.arcs.keys():
        bounds, turned = (0.0, *cuts[row], 1.0), arc_turned(motions, row)
        for i, (low, high) in enumerate(itertools.pairwise(bounds), start=int(first[row])):
            arc = part_of(motions.arcs[row], arc_ends(result, i), (high - low) * turned)
            arcs[i] = arc._replace(words=(None, None), pole_block=-1) if low > 0.0 else arc
    return replace(result, arcs=arcs)


def numbers_of_added(motions: Motions) -> list[int]:
    """Number of added rows before each row that belong to its block."""
    before = np.cumsum(motions.added) - motions.added
    numbers: list[int] = (before - before[np.searchsorted(motions.block, motions.block)]).tolist()
    return numbers


def _of_whole_moves(motions: Motions, rows: np.ndarray, shares: Array) -> Array:
    """Shares `(k,)` of programmed moves, of shares `(k,)` of rows `(k,)` that may be segments of them.

    They are nearest to the fractions of the sum, so that they can be written with small numbers.
    """
    from fractions import Fraction

    whole = shares.copy()
    begin, later = motions.start_fraction, np.append(motions.added[1:], False)
    end = np.where(later, np.append(begin[1:], 0.0), 1.0)
    for i in np.flatnonzero((np.isfinite(begin + end) & (motions.added | later))[rows]).tolist():
        low, high, share = (
            Fraction(each).limit_denominator(LARGEST_SHARE_DENOMINATOR)
            for each in (begin[rows[i]], end[rows[i]], shares[i])
        )
        whole[i] = float(low + share * (high - low))
    return whole


def part_of(arc: Arc, ends: tuple[Point, Point], turned: float) -> Arc:
    """The part of an arc with these ends and the sweep `turned`, rad."""
    full = same(*ends) and abs(turned) > math.pi
    once = sweep(*ends, arc.centre, arc.sense, full)
    return arc._replace(full=full, turns=round((turned - once) * arc.sense / (2 * math.pi)))


def like(nominal: Motions, commanded: Motions) -> Motions | None:
    """The nominal moves with the segments and backlash take-ups of the commanded ones; None for different moves."""
    own = np.flatnonzero(~commanded.added)
    if len(own) != len(nominal) or not _same_kinds(nominal.kind, commanded.kind[own]):
        return None
    moves = commanded.kind != Kind.TAKE_UP
    cuts = _cuts_of(nominal, commanded, commanded.added & moves)
    if cuts is None:
        return None
    result = split(nominal, cuts)
    if len(result) != int(moves.sum()):
        return None
    takes_up = np.flatnonzero(~moves)
    before = takes_up - np.arange(len(takes_up))
    if len(before) and before[-1] >= len(result):
        return None
    return with_backlash_take_ups(result, before, commanded.known[takes_up] == Known.PROGRAM)


def _same_kinds(nominal: np.ndarray, commanded: np.ndarray) -> bool:
    """True for the same kinds `(n,)` of moves; a conversion of the tool point writes arcs as straight lines."""
    lines_of_arcs = (nominal == Kind.ARC) & (commanded == Kind.LINE)
    return bool(((_kinds(nominal) == _kinds(commanded)) | lines_of_arcs).all())


def _kinds(kinds: np.ndarray) -> np.ndarray:
    """Kinds `(n,)` of moves: a hole of a pattern is like a rapid to a hole by itself."""
    return np.where(kinds == Kind.PATTERN, Kind.RAPID, kinds)


def _cuts_of(nominal: Motions, commanded: Motions, pieces: NDArrayBool) -> dict[int, list[float]] | None:
    """Shares at which the added `pieces` `(n,)` begin, by row of the nominal moves; None if they are unknown."""
    move = np.cumsum(~commanded.added) - 1
    cuts: dict[int, list[float]] = {}
    for row in np.flatnonzero(pieces).tolist():
        origin, share = int(move[row]), float(commanded.start_fraction[row])
        done = cuts.setdefault(origin, [])
        if math.isnan(share):
            found = _quadrant(nominal, origin, commanded, row, done[-1] if done else 0.0)
            if found is None:
                return None
            share = found
        if origin < 0 or not (done[-1] if done else 0.0) < share < 1.0:
            return None
        done.append(share)
    return cuts


def _quadrant(nominal: Motions, origin: int, commanded: Motions, row: int, behind: float) -> float | None:
    """Share of a nominal arc, within a turn after `behind`, of the reversal nearest to the start of a segment."""
    if origin not in nominal.arcs or row not in commanded.arcs:
        return None
    (x, y), _ = arc_ends(commanded, row)
    x0, y0 = commanded.arcs[row].centre
    (start, _), turned = arc_ends(nominal, origin), arc_turned(nominal, origin)
    centre = nominal.arcs[origin].centre
    angle, first = math.atan2(y - y0, x - x0), math.atan2(start[1] - centre[1], start[0] - centre[0])
    apart = [
        (abs(math.remainder(first + share * turned - angle, 2 * math.pi)), share)
        for share, _, _ in turning_points(nominal, origin)
        if behind < share < behind + NEARLY_A_TURN / abs(turned)
    ]
    return min(apart)[1] if apart else None


def with_backlash_take_ups(motions: Motions, before: np.ndarray, axes: NDArrayBool) -> Motions:
    """The moves with a backlash take-up of `axes` `(k, axes)` before rows `before` `(k,)`."""
    if not len(before):
        return motions
    result = motions.take(np.insert(np.arange(len(motions)), before, before))
    rows = before + np.arange(len(before))
    kind, added, target, known = result.copies("kind", "added", "target", "known")
    kind[rows] = Kind.TAKE_UP
    added[rows] = True
    target[rows] = result.start[rows]
    known[rows] = np.where(axes, Known.PROGRAM, np.minimum(result.known_start[rows], Known.MACHINE))
    gone = set(rows.tolist())
    left: dict[str, Any] = {
        name: {row: v for row, v in getattr(result, name).items() if row not in gone}
        for name in BY_ROW
        if name != "rotary_words"
    }
    return replace(result, kind=kind, added=added, target=target, known=known, words=result.words.without(rows), **left)
