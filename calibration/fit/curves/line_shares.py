"""Sizes of the straight lines in error motions, from those of all linear axes together.

The data of spheres choose one size for all error motions of linear axes, but leave some lines to this prior, as the
scale that all axes have in common. The lines of one class show their own size together: a common scale is about as
large as the differences of the axes' scales.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np
from scipy import linalg

from calibration.fit.curves.smooth_process import Processes, log_evidence
from kinematics.transforms import Array

LINE_SIZE_SHARES = (3.0, 1.0, 0.3)
"""Sizes of lines that are tried, as shares of the prior; equally probable before the data are seen (Type B)."""


def line_shares(
    processes: Mapping[str, Processes],
    free: Mapping[str, np.ndarray],
    information: Array,
    right: Array,
) -> dict[str, Array]:
    """Size of the line of each error motion of each axis, as a share of its prior.

    Averaged over those shares of each class that the data leave possible. free: masks of the error motions whose lines
    may differ from the prior. information `(q, q)` on the values of all error motions at the positions of all axes, and
    its product with the values `(q,)`.
    """
    classes = list(dict.fromkeys(which for own in processes.values() for which in own.classes))
    tried = np.array(list(product(LINE_SIZE_SHARES, repeat=len(classes))))
    odds = np.array([_evidence(processes, _by_axis(processes, free, classes, of), information, right) for of in tried])
    odds = np.exp(odds - odds.max())
    return _by_axis(processes, free, classes, np.sqrt(odds @ tried**2 / odds.sum()))


def _by_axis(
    processes: Mapping[str, Processes], free: Mapping[str, np.ndarray], classes: list[str], of_class: Array
) -> dict[str, Array]:
    """The share of each class, by axis and error motion."""
    return {
        axis: np.where(free[axis], of_class[[classes.index(which) for which in own.classes]], 1.0)
        for axis, own in processes.items()
    }


def _evidence(
    processes: Mapping[str, Processes], shares: Mapping[str, Array], information: Array, right: Array
) -> float:
    """Log probability of the data with lines of these shares, up to a constant."""
    scaled = [replace(own, trends=tuple(own.trends * shares[axis])) for axis, own in processes.items()]
    covariances = [own.covariance(own.positions, motion) for own in scaled for motion in range(len(own.classes))]
    root = linalg.block_diag(*map(np.linalg.cholesky, covariances))
    return log_evidence(root.T @ information @ root, root.T @ right)
