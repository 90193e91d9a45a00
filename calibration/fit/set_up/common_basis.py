"""One basis of an error motion for several measurements, which have chosen their own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kinematics.basis import Basis, BSpline, Fourier, Harmonics
from kinematics.machine import TURN_DEG


def common_basis(bases: Sequence[Basis], *, turning: bool) -> Basis:
    """The finest of the bases of one error motion, over the range of all; `turning`: its axis turns fully."""
    finest = min(bases, key=lambda basis: (basis.feature_length, -basis.size))
    low, high = min(basis.interval[0] for basis in bases), max(basis.interval[1] for basis in bases)
    if isinstance(finest, Harmonics) or (low, high) == finest.interval:
        return finest
    own_low, own_high = finest.interval
    if turning:
        return Harmonics((low, low + TURN_DEG), max(finest.size // 2, 1))
    if isinstance(finest, BSpline):
        spacing = (own_high - own_low) / (len(finest.nodes) - 1)
        beyond = own_low - low, high - own_high
        # less than half a spacing belongs to the last piece: a node at its end were free to jump
        before, behind = (math.ceil(each / spacing) if each >= spacing / 2.0 else 0 for each in beyond)
        lower, upper = np.linspace(low, own_low, before + 1).tolist(), np.linspace(own_high, high, behind + 1).tolist()
        inner = finest.nodes[1:-1]
        nodes = (*(lower if before else [low]), *inner, *(upper if behind else [high]))
        return BSpline(nodes, finest.degree)
    longer = (high - low) / (own_high - own_low)
    if isinstance(finest, Fourier):
        return Fourier((low, high), tuple(longer * waves for waves in finest.harmonics))
    return type(finest)((low, high), math.ceil(longer * finest.degree))
