"""Arcs of plain lines: their circles, as those of the same blocks that are read one by one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.motion.arcs import CENTRES, Ends, centre_letters, circle_by_centre, circle_by_radius
from postproc.motion.circles import radius_fault
from postproc.motion.moves import Arc, Known
from postproc.motion.plain_moves import PlainMoves
from postproc.text.blocks import PlainRun

RADIUS = "R"
"""Address of the radius in plain lines."""


class ArcModes(NamedTuple):
    """The modes of a control that give its arcs their meaning."""

    plane: str
    """Letters of the first, second and normal axis."""
    unit: float
    """mm per unit of the words."""
    absolute: bool
    """True if centres are positions."""


def arc_motion(run: PlainRun, motion: np.ndarray) -> tuple[NDArrayBool, NDArrayBool]:
    """Lines `(lines,)` that move along arcs, by the motion in force `(lines,)`, and those whose words contradict it.

    These are straight lines with words of arcs, and arcs without them.
    """
    first = len(run.lines.axes)
    curved = motion > 1
    return curved, curved != (run.columns.end[first:] > 0).any(axis=0)


def plain_arcs(
    run: PlainRun, moves: PlainMoves, motion: np.ndarray, curved: NDArrayBool, modes: ArcModes
) -> tuple[dict[int, Arc], int]:
    """The arcs of `curved` `(lines,)` by line, and the number of lines before the first one whose words give no arc.

    motion `(lines,)`: motion in force.
    """
    arcs: dict[int, Arc] = {}
    rows = np.flatnonzero(curved)
    first, second, normal = (run.lines.axes.index(letter) for letter in modes.plane)
    in_plane = np.array([first, second])
    starts, ends = (at[rows[:, None], in_plane].tolist() for at in (moves.start, moves.target))
    known = np.all(moves.known_start[rows[:, None], in_plane] != Known.ASSUMED, axis=1)
    senses = np.where(motion[rows] == 3, 1, -1)
    columns = rows.tolist(), senses.tolist(), starts, ends, known.tolist(), _words(run, rows, modes)
    for row, sense, start, end, is_known, words in zip(*columns, strict=True):
        circle = Ends((first, second, normal), sense, (start[0], start[1]), (end[0], end[1]))
        arc = _circle(circle, words, absolute=modes.absolute) if is_known else None
        if arc is None:
            return arcs, row
        arcs[row] = arc
    return arcs, len(run)


class _ArcWords(NamedTuple):
    """The words of one arc; indices are those of the words of its block, None where it has no such word."""

    centre: tuple[float, float]
    """mm; 0 where a word is missing."""
    indices: tuple[int | None, int | None]
    radius: float
    """mm."""
    radius_index: int | None
    outside: bool
    """True if a word other than 0 gives the centre along the normal of the plane."""


def _words(run: PlainRun, rows: np.ndarray, modes: ArcModes) -> Iterator[_ArcWords]:
    """The words of the arcs in lines `rows` `(k,)` of a run."""
    letters = centre_letters(modes.plane)
    (across,) = set(CENTRES) - set(letters)
    (a, i), (b, j), (r, radius) = (_column(run, letter, rows, modes.unit) for letter in (*letters, RADIUS))
    outside = [value != 0.0 for value in _column(run, across, rows, 1.0)[0]]
    for x, y, first, second, size, index, strange in zip(a, b, i, j, r, radius, outside, strict=True):
        yield _ArcWords((x, y), (first, second), size, index, strange)


def _column(run: PlainRun, letter: str, rows: np.ndarray, unit: float) -> tuple[list[float], list[int | None]]:
    """Values, mm, of the words with an address in lines `rows` `(k,)`, 0 where there are none, and their indices."""
    column = run.lines.addresses.find(letter)
    if column < 0:
        return list(itertools.repeat(0.0, len(rows))), list(itertools.repeat(None, len(rows)))
    named = run.columns.end[column, rows] > 0
    values = np.where(named, run.columns.value[column, rows] * unit, 0.0)
    indices = np.full(len(rows), None)
    indices[named] = run.lines.order_of(column, run.first + rows[named])
    return values.tolist(), indices.tolist()


def _circle(ends: Ends, words: _ArcWords, *, absolute: bool) -> Arc | None:
    """The arc with these ends; None if the words give none."""
    if words.radius_index is not None:
        if words.indices != (None, None) or words.outside:
            return None
        form = "radius-absolute" if absolute else "radius"
        return circle_by_radius(ends, words.radius, words.radius_index, form)
    if words.outside or words.indices == (None, None) or (absolute and None in words.indices):
        return None
    arc = circle_by_centre(ends, words.centre, words.indices, absolute=absolute)
    return arc if radius_fault(ends.start, ends.end, arc.centre) is None else None
