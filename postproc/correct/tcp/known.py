"""Which positions of a converted move the program has given."""

from __future__ import annotations

import numpy as np

from kinematics.machine import NDArrayBool
from postproc.correct.tcp.path import shares
from postproc.motion.frames import cartesian
from postproc.motion.motions import Motions
from postproc.motion.moves import Known


def known_in_other(motions: Motions, rows: NDArrayBool) -> tuple[np.ndarray, np.ndarray]:
    """`known` and `known_start` of the moves, those of some rows `(n,)` in the other coordinates.

    X, Y or Z there is given if all coordinates are on which it depends. None is while a rotary axis is at a position
    that the program has not given.
    """
    known, known_start = motions.copies("known", "known_start")
    linear, rotary = np.array(cartesian(motions.machine)), np.flatnonzero(motions.machine.rotary)
    some = np.flatnonzero(rows)
    for column, program in ((known, motions.target), (known_start, motions.start)):
        partly = some[(column[np.ix_(some, linear)] != Known.PROGRAM).any(axis=1)]
        if len(partly):
            depends = shares(motions.bare.take(partly), program[partly])
            own = column[np.ix_(partly, linear)]
            column[np.ix_(partly, linear)] = np.where(depends, own[:, None, :], Known.PROGRAM).min(axis=2)
        assumed = some[(column[np.ix_(some, rotary)] == Known.ASSUMED).any(axis=1)]
        column[np.ix_(assumed, linear)] = Known.ASSUMED
    return known, known_start
