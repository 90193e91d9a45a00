"""Corrected programs inside a test: their text without the mark, and the rows that a test compares."""

import re

import numpy as np

from postproc.motion.circles import sweep
from postproc.motion.moves import Kind

MARK = re.compile(r"\(NCOMP \S+ MACHINE \S+ CALIBRATION [0-9A-F]+ PROGRAM [0-9A-F]{12}[^)]*\)(\r*\n|\r)")


def without_mark(text):
    stripped, marks = MARK.subn("", text)
    assert marks == 1
    return stripped


def turns(motions):
    """Feed moves of rotary axes alone."""
    way = np.abs(motions.target - motions.start)
    linear, rotary = list(motions.machine.translators), motions.machine.rotary
    return (motions.kind == Kind.LINE) & (way[:, linear] < 1e-6).all(axis=1) & (way[:, rotary] > 1e-6).any(axis=1)


def exact_rows(motions):
    """Rows that end where they should: not feed moves of rotary axes alone, nor what follows them as a circle.

    Nor circles that are full or nearly so, which end where they start.
    """
    rows, turning = motions.evaluated.copy(), turns(motions)
    for row, arc in motions.arcs.items():
        i, j, _ = arc.plane
        ends = [(float(at[row, i]), float(at[row, j])) for at in (motions.start, motions.target)]
        if abs(sweep(*ends, arc.centre, arc.sense, arc.full)) > 5.2 or (row and turning[row - 1]):
            rows[row] = False
    return rows & ~turning


def kept_before_turning(nominal, commanded):
    """Rows left as in the input because the feed move of rotary axes alone behind them would become worse.

    The end of an arc may be moved so that the difference of its radii does not grow.
    """
    permitted = np.where([row in nominal.arcs for row in range(len(nominal))], 2e-3, 1e-4)
    return np.append(turns(nominal)[1:], False) & (permitted > np.abs(commanded.target - nominal.target).T).all(axis=0)
