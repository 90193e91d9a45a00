"""The instrument's noise from repeats alone: rows of the same commands, target, station and approach.

Repeats share the machine's errors. They differ by noise, and by drift or motion between them. Repeats soon after one
another (CLOSE_S, or CLOSE_ROWS where no time is recorded) show the noise. Where these are too few, all repeats are
used (`apart`), and the noise may be less than they show. The zero of each run of an interferometer is unknown and is
estimated along with the noise. A touch probe records its noise in the positions of the linear axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calibration.measurement.measurement import Measurement
from calibration.observation import equations
from calibration.observation.normal_equations import whitened, whiteners
from calibration.observation.outliers import first_registration
from calibration.plausibility.repeated_positions import position_numbers
from kinematics.files.number_text import probability
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.transforms import Array

CLOSE_S = 120.0
CLOSE_ROWS = 8
ENOUGH = 12
"""Degrees of freedom, in scalars, from which close repeats are used alone."""
ROUNDS = 200
SETTLED = 1e-9
"""Relative change of the residuals below which the zeros of the runs have converged."""


class Component(NamedTuple):
    """Noise in one observed direction; standard deviations, k = 1."""

    name: str
    """range, azimuth, elevation; deviation; x, y, z."""
    unit: str
    """um or urad."""
    noise: float
    specified: float
    """RMS of the specified standard deviations of these rows."""


@dataclass(frozen=True)
class Repeats:
    """Noise from repeats, compared with the instrument specification."""

    states: int
    """Number of measurement states that were measured again."""
    degrees_of_freedom: int
    """Degrees of freedom of the noise, in scalars."""
    factor: float
    """Ratio of the repeats' variance to the specified variance."""
    p_value: float
    """Two-sided p-value of the specification: small where repeats scatter more, or less, than specified."""
    components: tuple[Component, ...]
    apart: bool
    """True where the repeats lie so far apart in time that they contain drift."""

    @property
    def text(self) -> str:
        """The result in one sentence."""
        noise = ", ".join(f"{c.name} {c.noise:.3g} {c.unit} (specified {c.specified:.3g})" for c in self.components)
        when = "far apart in time, with all drifts in them" if self.apart else "soon after one another"
        p = probability(self.p_value, 2)
        return f"from {self.states} positions measured again, {when}: {noise}; specification {p}"


def repeats(measurement: Measurement, kept: np.ndarray) -> Repeats | None:
    """Noise from repeats among the rows kept, a mask `(n,)`; None without repeats."""
    own = measurement.rows(np.flatnonzero(kept))
    if not len(own):
        return None
    if own.instrument.OBSERVES == "offset":
        own = _as_readings(own)
    states = position_numbers(own)
    close = _repeated(own, _clusters(own, states))
    if close.degrees_of_freedom * own.instrument.components >= ENOUGH:
        return _evaluated(own, close, states, apart=False)
    all_of_them = _repeated(own, states)
    if all_of_them.degrees_of_freedom > close.degrees_of_freedom:
        return _evaluated(own, all_of_them, states, apart=True)
    return _evaluated(own, close, states, apart=False) if close.degrees_of_freedom > 0 else None


def _as_readings(measurement: Measurement) -> Measurement:
    """A touch probe's measurement with the nominal tip in the centres of the spheres, and the remainder as readings.

    The positions of the linear axes, in which a probe records a centre, are then the same in repeats.
    """
    machine, q, tool = measurement.machine, measurement.state.positions, measurement.tool
    centres = first_registration(measurement)[0].sphere_centres
    points = np.array([centres[sphere] for sphere in measurement.groups.tolist()])
    observed = measurement.observed + points - tool_point(machine, q, tool)
    state = replace(measurement.state, positions=linear_positions(machine, q, points, tool))
    return replace(measurement, state=state, observed=observed)


class _Again(NamedTuple):
    """Repeated rows, the numbers of their clusters, and the degrees of freedom of the noise."""

    rows: np.ndarray
    cluster: np.ndarray
    zero: np.ndarray
    """Number `(rows,)` of the run whose zero the row contains; 0 for all rows where there are no zeros."""
    degrees_of_freedom: int
    """Degrees of freedom per component."""


def _clusters(measurement: Measurement, states: np.ndarray) -> np.ndarray:
    """Cluster numbers `(n,)`: rows of one measurement state that follow soon after one another."""
    time = measurement.state.time
    when, limit = (np.arange(len(states)), CLOSE_ROWS) if time is None else (time, CLOSE_S)
    order = np.lexsort((when, states))
    new = np.append(True, (np.diff(states[order]) != 0) | (np.diff(when[order]) > limit))
    result = np.empty(len(states), int)
    result[order] = np.cumsum(new) - 1
    return result


def _repeated(measurement: Measurement, cluster: np.ndarray) -> _Again:
    """The rows whose cluster has several rows."""
    rows = np.flatnonzero(np.bincount(cluster)[cluster] > 1)
    _, number = np.unique(cluster[rows], return_inverse=True)
    zero = np.zeros(len(rows), int)
    if measurement.axis is not None:
        _, zero = np.unique(measurement.groups[rows], return_inverse=True)
    if not len(rows):
        return _Again(rows, number, zero, 0)
    sizes = int(number.max()) + 1, int(zero.max()) + 1
    graph = coo_array((np.ones(len(rows)), (number, sizes[0] + zero)), shape=(sum(sizes), sum(sizes)))
    parts, _ = connected_components(graph, directed=False)
    unknown = sum(sizes) - parts if sizes[1] > 1 else sizes[0]
    return _Again(rows, number, zero, len(rows) - unknown)


def _evaluated(measurement: Measurement, again: _Again, states: np.ndarray, *, apart: bool) -> Repeats | None:
    """Noise of these rows, compared with the specification; None without degrees of freedom."""
    if again.degrees_of_freedom < 1:
        return None
    own = measurement.rows(again.rows)
    deviations = _deviations(own, again)
    degrees_of_freedom = again.degrees_of_freedom * own.instrument.components
    chi2 = float(np.sum(whitened(whiteners(own), deviations) ** 2))
    p_value = 2.0 * min(float(special.chdtrc(degrees_of_freedom, chi2)), float(special.chdtr(degrees_of_freedom, chi2)))
    return Repeats(
        len(np.unique(states[again.rows])),
        degrees_of_freedom,
        chi2 / degrees_of_freedom,
        min(p_value, 1.0),
        _components(own, deviations, again.degrees_of_freedom),
        apart,
    )


def _deviations(measurement: Measurement, again: _Again) -> Array:
    """Observations `(rows, d)` less the mean of their cluster and the zero of their run."""
    deviations = _less_mean(measurement.observed, again.cluster)
    if not again.zero.any():
        return deviations
    for _ in range(ROUNDS):
        before = deviations
        deviations = _less_mean(_less_mean(deviations, again.zero), again.cluster)
        if np.abs(deviations - before).max() <= SETTLED * np.abs(deviations).max():
            break
    return deviations


def _less_mean(values: Array, number: np.ndarray) -> Array:
    sums = np.zeros((int(number.max()) + 1, values.shape[1]))
    np.add.at(sums, number, values)
    return np.asarray(values - (sums / np.bincount(number)[:, None])[number])


def _components(measurement: Measurement, deviations: Array, degrees_of_freedom: int) -> tuple[Component, ...]:
    """Noise by direction, separately for rows of linear and of rotary axes."""
    covariance = equations.covariance(measurement)
    share = degrees_of_freedom / len(deviations)
    if not measurement.instrument.BY_BEAM:
        names = ["deviation"] if measurement.instrument.components == 1 else list("xyz")[: deviations.shape[1]]
        micro = measurement.per_micro[:, 0]
        found = []
        for size, unit in ((1e3, "um"), (1e6, "urad")):
            rows = micro == size
            for k, name in enumerate(names) if rows.any() else ():
                noise, specified = np.mean(deviations[rows, k] ** 2) / share, np.mean(covariance[rows, k, k])
                found.append(Component(name, unit, float(noise**0.5 * size), float(specified**0.5 * size)))
        return tuple(found)
    frame = _beam_frame(measurement.observed)
    own, variances = np.einsum("nij,nj->ni", frame, deviations), np.einsum("nij,njk,nik->ni", frame, covariance, frame)
    return tuple(
        Component(
            name,
            "um",
            float(np.sqrt(np.mean(own[:, k] ** 2) / share)) * 1e3,
            float(np.sqrt(np.mean(variances[:, k]))) * 1e3,
        )
        for k, name in enumerate(("range", "azimuth", "elevation"))
    )


def _beam_frame(points: Array) -> Array:
    """Rotations `(n, 3, 3)` whose rows point along the beam, across it to the left, and up; points `(n, 3)`."""
    beam = points / np.linalg.norm(points, axis=1, keepdims=True)
    left = np.cross([0.0, 0.0, 1.0], beam)
    size = np.linalg.norm(left, axis=1, keepdims=True)
    left = np.where(size > 1e-9, left / np.maximum(size, 1e-9), [0.0, 1.0, 0.0])
    return np.stack([beam, left, np.cross(beam, left)], axis=1)
