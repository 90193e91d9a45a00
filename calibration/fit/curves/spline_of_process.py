"""The cubic spline that follows the processes of an axis."""

from __future__ import annotations

import numpy as np

from calibration.fit.curves.smooth_process import Processes
from kinematics.basis import BSpline
from kinematics.transforms import Array

LACKING = 0.01
"""Share of the size of a process, at most, that a spline among many positions may lack anywhere."""
EVERYWHERE = 193
"""Number of positions at which the spline is compared with the processes."""


def following(processes: Processes, interval: tuple[float, float]) -> BSpline:
    """The cubic spline with the fewest nodes that follows the processes of an axis."""
    k = len(processes.positions)
    tried = (cubic(interval, nodes) for nodes in range(5, k, 2))
    return next((basis for basis in tried if _lacked(processes, basis) <= LACKING), cubic(interval, k))


def cubic(interval: tuple[float, float], nodes: int) -> BSpline:
    """The cubic spline with equidistant nodes over an interval, mm or degrees."""
    return BSpline(tuple(np.linspace(*interval, nodes).tolist()), 3)


def _lacked(processes: Processes, basis: BSpline) -> float:
    """Largest standard deviation of a process from the spline through it, as a share of its size."""
    x, everywhere = _determining(basis), np.linspace(*basis.interval, EVERYWHERE)
    through = np.hstack([-np.linalg.solve(basis.columns(x).T, basis.columns(everywhere).T).T, np.eye(len(everywhere))])
    both, shares, kinds = np.concatenate([x, everywhere]), [], zip(processes.classes, processes.trends, strict=True)
    # error motions of one class and trend have the same process
    for motion in {key: motion for motion, key in enumerate(kinds)}.values():
        variances = np.sum(through @ processes.covariance(both, motion) * through, axis=1)
        shares.append(variances.max() / processes.size(processes.classes[motion]) ** 2)
    return float(np.sqrt(max(shares)))


def root_of(processes: Processes, motion: int, basis: BSpline) -> Array:
    """Root of the covariance of the parameters of a spline that is the process of an error motion."""
    x = _determining(basis)
    return np.asarray(np.linalg.solve(basis.columns(x), np.linalg.cholesky(processes.covariance(x, motion))))


def _determining(basis: BSpline) -> Array:
    """Positions at which the values of a cubic spline determine its parameters, mm or degrees."""
    nodes = np.array(basis.nodes)
    knots = np.concatenate([nodes[[0, 0]], nodes, nodes[[-1, -1]]])
    return np.asarray((knots[:-2] + knots[1:-1] + knots[2:]) / 3.0)
