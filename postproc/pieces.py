"""Moves in more rows than the program has blocks for: arcs in pieces, and take-ups before moves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.circles import Point, quadrants, same, sweep
from postproc.motions import BY_ROW, Arc, Kind, Known, Motions


def arc_ends(motions: Motions, row: int) -> tuple[Point, Point]:
    """Start and end of an arc in its plane, programmed coordinates, mm."""
    i, j, _ = motions.arcs[row].plane
    start, end = motions.start[row].tolist(), motions.target[row].tolist()
    return (start[i], start[j]), (end[i], end[j])


def arc_turned(motions: Motions, row: int) -> float:
    """Angle that an arc turns through, rad, positive counter-clockwise."""
    arc = motions.arcs[row]
    return sweep(*arc_ends(motions, row), arc.centre, arc.sense, arc.full, arc.turns)


def turning_points(motions: Motions, row: int) -> Iterator[tuple[float, int, float]]:
    """Where the axes of its plane turn back within an arc, in the order of its way.

    Share of the way, column of the axis, and how far, mm, it goes there and back within the arc: the less of both.
    """
    arc, (start, _), turned = motions.arcs[row], arc_ends(motions, row), arc_turned(motions, row)
    radius = math.dist(start, arc.centre)
    for share, coordinate in quadrants(start, arc.centre, turned):
        nearer = min(share, 1.0 - share) * abs(turned)
        yield share, arc.plane[coordinate], radius * (1.0 - math.cos(min(nearer, math.pi)))


def split(motions: Motions, cuts: Mapping[int, Sequence[float]]) -> Motions:
    """The moves with some arcs, by row, in pieces that end at shares of their way.

    The first piece keeps the block; the others are `added`, and name no axis.
    """
    if not cuts:
        return motions
    pieces = np.ones(len(motions), int)
    for row, shares in cuts.items():
        pieces[row] += len(shares)
    result = motions.take(np.repeat(np.arange(len(motions)), pieces))
    first = np.cumsum(pieces) - pieces
    for row, shares in cuts.items():
        at = int(first[row])
        ends = [motions.take(np.array([row])).along(share)[0] for share in shares]
        for i, place in enumerate(ends):
            result.target[at + i] = result.start[at + i + 1] = place
        later = slice(at + 1, at + len(shares) + 1)
        result.added[later] = result.settled[later] = True
        result.known_start[later] = motions.known[row]
        if result.words:
            result.words[later] = [()] * len(shares)
        bounds, turned = (0.0, *shares, 1.0), arc_turned(motions, row)
        for i, (begin, end) in enumerate(itertools.pairwise(bounds), start=at):
            result.arcs[i] = _piece(motions.arcs[row], arc_ends(result, i), (end - begin) * turned)
            if i > at:
                result.arcs[i] = result.arcs[i]._replace(words=(None, None), pole_block=-1)
    return result


def _piece(arc: Arc, ends: tuple[Point, Point], turned: float) -> Arc:
    """A part of an arc with these ends, that turns through `turned`, rad."""
    full = same(*ends) and abs(turned) > math.pi
    once = sweep(*ends, arc.centre, arc.sense, full)
    return arc._replace(full=full, turns=round((turned - once) * arc.sense / (2 * math.pi)))


def like(nominal: Motions, commanded: Motions) -> Motions | None:
    """The nominal moves, cut and with take-ups as the commanded ones; None where these are not the same moves.

    A piece ends where an axis turns back: at the quarter of the nominal circle that is nearest.
    """
    own = np.flatnonzero(~commanded.added)
    if len(own) != len(nominal) or not np.array_equal(nominal.kind, commanded.kind[own]):
        return None
    move = np.cumsum(~commanded.added) - 1
    moves = commanded.kind != Kind.TAKE_UP
    inner = commanded.inner
    cuts: dict[int, list[float]] = {}
    for row in np.flatnonzero(inner & moves).tolist():
        origin = int(move[row])
        if origin not in nominal.arcs or row not in commanded.arcs:
            return None
        _, (x, y) = arc_ends(commanded, row)
        x0, y0 = commanded.arcs[row].centre
        (start, _), turned = arc_ends(nominal, origin), arc_turned(nominal, origin)
        points = quadrants(start, nominal.arcs[origin].centre, turned)
        angle = math.atan2(y - y0, x - x0)
        first = math.atan2(start[1] - nominal.arcs[origin].centre[1], start[0] - nominal.arcs[origin].centre[0])
        apart = [abs(math.remainder(first + share * turned - angle, 2 * math.pi)) for share, _ in points]
        left = [(a, share) for a, (share, _) in zip(apart, points, strict=True) if share > max(cuts.get(origin, [0.0]))]
        if not left:
            return None
        cuts.setdefault(origin, []).append(min(left)[1])
    result = split(nominal, cuts)
    if len(result) != int(moves.sum()):
        return None
    takes_up = np.flatnonzero(~moves)
    before = takes_up - np.arange(len(takes_up))
    if len(before) and before[-1] >= len(result):
        return None
    return with_take_ups(result, before, commanded.known[takes_up] == Known.PROGRAM)


def with_take_ups(motions: Motions, before: np.ndarray, axes: NDArrayBool) -> Motions:
    """The moves with a take-up before some rows `before` `(k,)`, of `axes` `(k, axes)`."""
    if not len(before):
        return motions
    result = motions.take(np.insert(np.arange(len(motions)), before, before))
    rows = before + np.arange(len(before))
    result.kind[rows] = Kind.TAKE_UP
    result.added[rows] = True
    result.target[rows] = result.start[rows]
    result.known[rows] = np.where(axes, Known.PROGRAM, np.minimum(result.known_start[rows], Known.MACHINE))
    gone = set(rows.tolist())
    words = [() if i in gone else words for i, words in enumerate(result.words)]
    left: dict[str, Any] = {
        name: {row: v for row, v in getattr(result, name).items() if row not in gone} for name in BY_ROW
    }
    return replace(result, words=words, **left)
