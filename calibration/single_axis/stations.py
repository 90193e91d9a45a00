"""Points observed from one or several stations of a tracker, in one frame, with their covariance.

Every point that is observed more than once, in another round or from another station, is one unknown besides the poses
of the stations: observed = pose(point), weighted least squares (a bundle adjustment with full covariance). With
stations on different sides, the accurate ranges replace the less accurate angles.

Uncertainty by the GUM: the instrument specification (Type B) is propagated through the equations. Specification and
scatter of the rounds describe the same readings, so they are not added (GUM 4.3.10). But the scatter may also contain
the machine's repeatability, which the specification does not include. If the scatter is significantly too large, the
variance of that repeatability is estimated from it (Type A): the variance that, added to every reading, reduces chi2 to
its degrees of freedom (Mandel and Paule).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from calibration.measurement.measurement import Measurement
from calibration.registration.registration import Registration, rigid
from kinematics.transforms import Array, Pose, by_turn
from kinematics.user_error import UserError

STATION_ROUNDS = 20
LAST_STATION_STEP = 1e-9
"""Step, mm and rad, below which the iteration ends."""
VARIANCE_CONVERGED = 1e-3
"""Relative change of the repeatability's variance below which its search ends."""
SIGNIFICANT = 0.95
"""Probability that the scatter of a measurement within the specification stays below the limit."""


@dataclass(frozen=True)
class Points:
    """Points in the frame of the anchors; mm."""

    positions: Array
    """Coordinates `(n, 3)`."""
    covariance: Array
    """Covariance `(3n, 3n)`, mm2, from specification and repeatability together."""
    repeatability_covariance: Array
    """Part of the covariance `(3n, 3n)`, mm2, from the machine's repeatability (Type A)."""
    information: Array
    """Information `(n, 3, 3)`, 1/mm2, on each point from its own readings alone, for known poses of the stations."""
    registration: Registration
    repeatability_um: float
    """Standard uncertainty of each coordinate of one reading in addition to the specification; 0 if that explains the
    scatter."""
    chi2: float
    """chi2 of the readings about the points, with the specification alone."""
    degrees_of_freedom: int
    """Degrees of freedom of the scatter; 0 if every point was observed once."""


def locate(measurement: Measurement, point: np.ndarray, anchors: Mapping[int, Array]) -> Points:
    """All points of a measurement; `point` `(rows,)` is the number of the point observed in a row.

    `anchors`: given positions `(3,)`, mm, by point. In the resulting frame the points lie nearest to their anchors.
    UserError if the anchors do not determine the frame.
    """
    numbers, nominal = _anchors(measurement, anchors)
    poses = _first_poses(measurement, point, numbers, nominal)
    return _solve(_Bundle(measurement, point, numbers, nominal), poses)


@dataclass(frozen=True)
class _Bundle:
    """The readings and the anchors of the frame."""

    measurement: Measurement
    point: np.ndarray
    anchors: np.ndarray
    """Numbers `(m,)` of the anchored points."""
    nominal: Array
    """Given positions `(m, 3)` of the anchored points, mm."""

    @property
    def size(self) -> int:
        """Number of points."""
        return int(self.point.max()) + 1


def _anchors(measurement: Measurement, anchors: Mapping[int, Array]) -> tuple[np.ndarray, Array]:
    numbers = np.array(sorted(anchors))
    nominal = np.array([anchors[number] for number in numbers.tolist()]).reshape(-1, 3)
    spread = np.linalg.svd(nominal - nominal.mean(axis=0), compute_uv=False) if len(numbers) else np.zeros(3)
    if len(numbers) < 3 or spread[1] < 1e-3 * max(spread[0], 1.0):
        raise UserError(
            f"{measurement.source}: no points determine the frame: three points that are not in one line are needed on "
            "the tool (datums: on the bed)"
        )
    return numbers, nominal


def _first_poses(measurement: Measurement, point: np.ndarray, numbers: np.ndarray, nominal: Array) -> Registration:
    """Pose of each station from the anchors that it observes; UserError if these are too few."""
    anchor = np.searchsorted(numbers, point).clip(max=len(numbers) - 1)
    anchored = numbers[anchor] == point
    poses, centres = {}, {}
    for group in np.unique(measurement.groups).tolist():
        mine = measurement.groups == group
        rows = mine & anchored
        if len(np.unique(point[rows])) < 3:
            raise UserError(
                f"{measurement.source}: station {group} observes fewer than three of the points that determine the "
                "frame (on the tool; datums: on the bed)"
            )
        poses[group] = rigid(nominal[anchor[rows]], measurement.observed[rows])
        centres[group] = measurement.observed[mine].mean(axis=0)
    return Registration(poses, centres)


def _solve(bundle: _Bundle, poses: Registration) -> Points:
    """Gauss-Newton adjustment, then the repeatability, then adjustment again with it, until the variance converges."""
    specified = bundle.measurement.covariances
    weights = _inverses(specified)
    positions, registration = _adjust(bundle, weights, _initial_positions(bundle, poses), poses)
    dof = 3 * len(bundle.measurement) - 3 * bundle.size - 6 * (len(poses.poses) - 1)
    scatter = _chi2(bundle, weights, positions, registration)
    variance = 0.0
    if dof > 0 and scatter > special.chdtri(dof, 1.0 - SIGNIFICANT):
        for _ in range(STATION_ROUNDS):
            before, variance = variance, _repeatability(bundle, specified, positions, registration, dof)
            weights = _inverses(specified + variance * np.eye(3))
            positions, registration = _adjust(bundle, weights, positions, registration)
            if abs(variance - before) < VARIANCE_CONVERGED * variance:
                break
    rotation = registration.rotations(bundle.measurement)
    normal = _normal_matrix(bundle, weights, positions, registration)
    inverse = _bordered_inverse(normal, _frame(bundle, positions, len(normal)))
    size = 3 * bundle.size
    doubled = _normal_matrix(bundle, weights @ weights, positions, registration)
    repeated = variance * (inverse @ doubled @ inverse)[:size, :size]
    information = np.zeros((bundle.size, 3, 3))
    np.add.at(information, bundle.point, rotation.swapaxes(1, 2) @ weights @ rotation)
    own = inverse[:size, :size]
    return Points(
        positions, 0.5 * (own + own.T), repeated, information, registration, 1e3 * variance**0.5, scatter, dof
    )


def _initial_positions(bundle: _Bundle, poses: Registration) -> Array:
    """Initial positions `(n, 3)`, mm: means of the observations from all stations."""
    rotation = poses.rotations(bundle.measurement)
    shift = np.array([poses.poses[group].translation[0] for group in bundle.measurement.groups.tolist()])
    back = Pose(rotation, shift).inverse().apply(bundle.measurement.observed)
    total = np.zeros((bundle.size, 3))
    np.add.at(total, bundle.point, back)
    return np.asarray(total / np.bincount(bundle.point, minlength=bundle.size)[:, None])


def _adjust(bundle: _Bundle, weights: Array, positions: Array, poses: Registration) -> tuple[Array, Registration]:
    """Least-squares positions `(n, 3)`, mm, and poses, with the anchors nearest to their nominal positions."""
    size = 3 * bundle.size
    for _ in range(STATION_ROUNDS):
        misfit = _misfit(bundle, positions, poses)
        designs = _designs(bundle, positions, poses)
        right = np.zeros(size + 6 * len(poses.poses))
        for columns, design in designs:
            np.add.at(right, columns, np.einsum("nij,ni->nj", design, np.einsum("nij,nj->ni", weights, misfit)))
        normal = _normal_matrix(bundle, weights, positions, poses)
        frame = _frame(bundle, positions, len(normal))
        away = (positions[bundle.anchors] - bundle.nominal).reshape(-1)
        target = -frame[:, (3 * bundle.anchors[:, None] + np.arange(3)).reshape(-1)] @ away
        step = _bordered_solve(normal, frame, right, target)
        positions = positions + step[:size].reshape(-1, 3)
        poses = poses.moved(step[size:])
        if np.abs(step).max() < LAST_STATION_STEP:
            break
    return positions, poses


def _misfit(bundle: _Bundle, positions: Array, poses: Registration) -> Array:
    """Observed minus expected `(rows, 3)`, mm."""
    return bundle.measurement.observed - poses.apply(bundle.measurement, positions[bundle.point])


def _chi2(bundle: _Bundle, weights: Array, positions: Array, poses: Registration) -> float:
    misfit = _misfit(bundle, positions, poses)
    return float(np.einsum("ni,nij,nj->", misfit, weights, misfit))


def _repeatability(bundle: _Bundle, specified: Array, positions: Array, poses: Registration, dof: int) -> float:
    """Variance, mm2, of each coordinate, added to the specification, for which chi2 equals its degrees of freedom."""
    from scipy.optimize import brentq

    def excess(variance: float) -> float:
        return _chi2(bundle, _inverses(specified + variance * np.eye(3)), positions, poses) - dof

    largest = float(np.max(_misfit(bundle, positions, poses) ** 2)) * 10.0
    return float(brentq(excess, 0.0, largest, xtol=1e-12))


def _designs(bundle: _Bundle, positions: Array, poses: Registration) -> list[tuple[np.ndarray, Array]]:
    """Columns `(rows, k)` of the unknowns of each row, and its derivatives `(rows, 3, k)`: first point, then pose."""
    measurement = bundle.measurement
    names = np.array(list(poses.poses))
    station = np.argsort(names)[np.searchsorted(np.sort(names), measurement.groups)]
    centres = np.array([poses.centres[name] for name in names.tolist()])
    arms = poses.apply(measurement, positions[bundle.point]) - centres[station]
    by_pose = np.empty((len(measurement), 3, 6))
    by_pose[:, :, :3] = np.eye(3)
    by_pose[:, :, 3:] = by_turn(arms)
    own = 3 * bundle.point[:, None] + np.arange(3)
    pose = 3 * bundle.size + 6 * station[:, None] + np.arange(6)
    return [(own, poses.rotations(measurement)), (pose, by_pose)]


def _normal_matrix(bundle: _Bundle, weights: Array, positions: Array, poses: Registration) -> Array:
    """Normal matrix of points and poses."""
    designs = _designs(bundle, positions, poses)
    normal = np.zeros((3 * bundle.size + 6 * len(poses.poses),) * 2)
    for left, first in designs:
        for right, second in designs:
            block = first.swapaxes(1, 2) @ weights @ second
            np.add.at(normal, (left[:, :, None], right[:, None, :]), block)
    return normal


def _frame(bundle: _Bundle, positions: Array, width: int) -> Array:
    """Conditions `(6, width)` that fix the frame: no mean shift and no mean rotation of the anchors."""
    count = len(bundle.anchors)
    arms = positions[bundle.anchors] - positions[bundle.anchors].mean(axis=0)
    arms = arms / np.sqrt(np.mean(arms**2))
    rows = np.zeros((6, width))
    for k in range(3):
        rows[k, 3 * bundle.anchors + k] = 1.0
        for j, turned in enumerate(np.cross(np.eye(3)[k], arms).T):
            rows[3 + k, 3 * bundle.anchors + j] = turned
    return np.asarray(rows / np.sqrt(count))


def _bordered(normal: Array, frame: Array) -> tuple[Array, float]:
    """The normal matrix bordered by its scaled conditions, and the scale."""
    scale = float(np.mean(np.diag(normal)))
    k = len(frame)
    return np.block([[normal, scale * frame.T], [scale * frame, np.zeros((k, k))]]), scale


def _bordered_solve(normal: Array, frame: Array, right: Array, target: Array) -> Array:
    matrix, scale = _bordered(normal, frame)
    return np.asarray(np.linalg.solve(matrix, np.concatenate([right, scale * target]))[: len(normal)])


def _bordered_inverse(normal: Array, frame: Array) -> Array:
    matrix, _ = _bordered(normal, frame)
    return np.asarray(np.linalg.inv(matrix)[: len(normal), : len(normal)])


def _inverses(matrices: Array) -> Array:
    return np.asarray(np.linalg.inv(matrices))
