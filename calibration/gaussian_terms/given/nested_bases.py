"""Nested bases: a refined basis contains every function of the coarse one, so that error motions in both are one."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np

from calibration.gaussian_terms.posterior import ROUNDING
from kinematics.basis import Basis, BSpline, Fourier, Harmonics, Legendre, Polynomial
from kinematics.transforms import Array

MOST_HARMONICS = 50
"""Highest degree and order of a basis."""
SAMPLES_OF_FEATURE = 8
"""Positions in each feature of a basis at which functions are compared."""


def refined(basis: Basis) -> Basis:
    """The nested basis of half the feature length: halved distances of nodes, or twice the degree or the harmonics."""
    match basis:
        case BSpline():
            nodes = np.array(basis.nodes)
            halved = np.sort(np.concatenate([nodes, (nodes[1:] + nodes[:-1]) / 2]))
            return BSpline(tuple(halved.tolist()), basis.degree)
        case Fourier():
            step = min((abs(n) for n in basis.harmonics), default=1.0)
            highest = max((abs(n) for n in basis.harmonics), default=0.0)
            added = highest + step * np.arange(1, max(len(basis.harmonics), 1) + 1)
            return Fourier(basis.interval, (*basis.harmonics, *added.tolist()))
        case Harmonics():
            return Harmonics(basis.interval, min(max(2 * basis.order, 1), MOST_HARMONICS))
        case Legendre() | Polynomial():
            return msgspec.structs.replace(basis, degree=min(max(2 * basis.degree, 1), MOST_HARMONICS))


def embedding(coarse: Basis, fine: Basis) -> Array | None:
    """The matrix `(q, p)` from the parameters of a function in the coarse basis to those of the same in the fine one.

    None where the fine basis does not contain every function of the coarse one.
    """
    return np.eye(fine.size) if coarse == fine else contained(coarse.columns, coarse, fine)


def contained(functions: Callable[[Array], Array], coarse: Basis, fine: Basis) -> Array | None:
    """Parameters `(q, k)` in a basis of k functions of position, `functions` `(n, k)`; None where it lacks one.

    coarse: a basis of the functions' smoothness; they are compared over both intervals.
    """
    low = min(coarse.interval[0], fine.interval[0])
    high = max(coarse.interval[1], fine.interval[1])
    x = np.linspace(low, high, SAMPLES_OF_FEATURE * (coarse.size + fine.size) + 1)
    x = np.unique(np.concatenate([x, *(basis.nodes for basis in (coarse, fine) if isinstance(basis, BSpline))]))
    columns, values = fine.columns(x), functions(x)
    parameters, *_ = np.linalg.lstsq(columns, values, rcond=None)
    misfit = float(np.abs(columns @ parameters - values).max(initial=0.0))
    return np.asarray(parameters) if misfit <= ROUNDING * float(np.abs(values).max(initial=0.0)) else None
