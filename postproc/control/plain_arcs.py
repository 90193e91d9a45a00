"""Arcs of plain lines: their circles, as those of the same blocks that are read one by one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.arcs import CENTRES, centre_letters
from postproc.motion.circle_columns import centres_by_radius
from postproc.motion.circles import RADIUS_TOLERANCE_MM, RADIUS_TOLERANCE_RATIO, SAME_POINT_MM
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
    rows = np.flatnonzero(curved)
    first, second, normal = (run.lines.axes.index(letter) for letter in modes.plane)
    in_plane = np.array([first, second])
    start, end = (_points(of[rows[:, None], in_plane]) for of in (moves.start, moves.target))
    known = np.all(moves.known_start[rows[:, None], in_plane] != Known.ASSUMED, axis=1)
    senses = np.where(motion[rows] == 3, 1, -1)
    words = _ArcWords.of(run, rows, modes)
    around = (0.0 if modes.absolute else start) + words.centre
    by_radius = words.radius_at >= 0
    centre = np.where(by_radius, centres_by_radius(start, end, words.radius, senses), around)
    short = np.abs(end - start) / 2 - np.abs(words.radius) > SAME_POINT_MM
    begun, ended = np.abs(start - around), np.abs(end - around)
    missing = (words.at < 0).any(axis=1) if modes.absolute else (words.at < 0).all(axis=1)
    out_of_round = np.abs(begun - ended) > np.maximum(RADIUS_TOLERANCE_MM, RADIUS_TOLERANCE_RATIO * begun)
    strange = np.where(
        by_radius,
        np.isnan(centre) | short | (words.at >= 0).any(axis=1),
        missing | out_of_round | (np.maximum(begun, ended) == 0.0),
    )
    strange |= words.outside | ~known
    number = int(strange.argmax()) if strange.any() else len(rows)
    full = (np.abs(end - start) < SAME_POINT_MM) & ~by_radius
    forms = ("radius-absolute" if modes.absolute else "radius", "absolute" if modes.absolute else "incremental")
    columns = (rows, senses, centre, full, by_radius, words.at, words.radius_at)
    arcs: dict[int, Arc] = {}
    for row, sense, at, is_full, has_radius, (i, j), r in zip(*(c[:number].tolist() for c in columns), strict=True):
        form, indices = (forms[0], (r, None)) if has_radius else (forms[1], (_index(i), _index(j)))
        arcs[row] = Arc((first, second, normal), sense, (at.real, at.imag), is_full, form, indices)
    return arcs, int(rows[number]) if number < len(rows) else len(run)


def _points(columns: np.ndarray) -> np.ndarray:
    """Points of two columns `(k, 2)` as complex numbers `(k,)`."""
    return np.asarray(columns[:, 0] + 1j * columns[:, 1])


def _index(at: int) -> int | None:
    return None if at < 0 else at


class _ArcWords(NamedTuple):
    """The words of arcs `(k,)`; indices are those of the words of their blocks, -1 where they have no such word."""

    centre: np.ndarray
    """Complex numbers, mm; 0 where a word is missing."""
    at: np.ndarray
    """Indices `(k, 2)` of the words of the centres."""
    radius: Array
    """mm."""
    radius_at: np.ndarray
    outside: NDArrayBool
    """True where a word other than 0 gives the centre along the normal of the plane."""

    @staticmethod
    def of(run: PlainRun, rows: np.ndarray, modes: ArcModes) -> _ArcWords:
        """The words of the arcs in lines `rows` `(k,)` of a run."""
        letters = centre_letters(modes.plane)
        (across,) = set(CENTRES) - set(letters)
        (a, i), (b, j), (radius, r) = (_column(run, letter, rows, modes.unit) for letter in (*letters, RADIUS))
        outside = _column(run, across, rows, 1.0)[0] != 0.0
        return _ArcWords(a + 1j * b, np.stack([i, j], axis=1), radius, r, np.asarray(outside))


def _column(run: PlainRun, letter: str, rows: np.ndarray, unit: float) -> tuple[Array, np.ndarray]:
    """Values, mm, of the words with an address in lines `rows` `(k,)`, 0 where there are none, and their indices."""
    values, indices = np.zeros(len(rows)), np.full(len(rows), -1)
    column = run.lines.addresses.find(letter)
    if column >= 0:
        named = run.columns.end[column, rows] > 0
        values[named] = run.columns.value[column, rows[named]] * unit
        indices[named] = run.lines.order_of(column, run.first + rows[named])
    return values, indices
