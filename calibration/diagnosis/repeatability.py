"""The instrument's noise from repeats alone: the same commands, target, station and way of approach, seen again.

Whatever the machine's errors, a repeat sees the same ones; what repeats differ by is noise, and what drifts or moves
between them. Repeats soon after one another (CLOSE_S, or CLOSE_ROWS where no time is known) tell the noise; where there
are too few of those all repeats are taken, `apart`, and the noise may be less than they say. The zero of each run of an
interferometer, which nobody knows, is estimated with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calibration.measurement.instruments import LaserTracker
from calibration.measurement.measurement import Measurement
from calibration.observation import equations
from calibration.observation.normal_equations import whitened, whiteners
from calibration.plausibility.repeated_positions import place_numbers
from kinematics.transforms import Array

CLOSE_S = 120.0
CLOSE_ROWS = 8
ENOUGH = 12
"""Degrees of freedom from which close repeats do without the others."""
ROUNDS = 200
SETTLED = 1e-9
"""Share of the noise that zeros of runs still move by when they have settled."""


class Component(NamedTuple):
    """One direction that the instrument observes in; standard deviations, k = 1."""

    name: str
    """range, azimuth, elevation; deviation; x, y, z."""
    unit: str
    """um or urad."""
    noise: float
    sheet: float
    """RMS of what the sheet says of these rows."""


@dataclass(frozen=True)
class Repeats:
    """What repeats say of the noise, and of the sheet."""

    places: int
    """Places that were seen again."""
    degrees_of_freedom: int
    """Scalars left over for the noise."""
    factor: float
    """Variance of the repeats in terms of the sheet's."""
    p_value: float
    """Of the sheet, two-sided: small when the repeats scatter more, or less, than it says."""
    components: tuple[Component, ...]
    apart: bool
    """True where the repeats lie so far apart in time that drifts are in them too."""

    @property
    def says(self) -> str:
        """One sentence."""
        noise = ", ".join(f"{c.name} {c.noise:.3g} {c.unit} (sheet {c.sheet:.3g})" for c in self.components)
        when = "long after one another, with all drifts in them" if self.apart else "soon after one another"
        return f"noise from {self.places} places seen again, {when}: {noise}; p of the sheet {self.p_value:.2g}"


def repeats(measurement: Measurement, kept: np.ndarray) -> Repeats | None:
    """The noise from repeats among the rows kept, a mask `(n,)`; None without any."""
    own = measurement.rows(np.flatnonzero(kept))
    if not len(own):
        return None
    places = place_numbers(own)
    close = _seen_again(own, _clusters(own, places))
    if close.degrees_of_freedom * own.instrument.components >= ENOUGH:
        return _judged(own, close, places, apart=False)
    all_of_them = _seen_again(own, places)
    if all_of_them.degrees_of_freedom > close.degrees_of_freedom:
        return _judged(own, all_of_them, places, apart=True)
    return _judged(own, close, places, apart=False) if close.degrees_of_freedom > 0 else None


class _Again(NamedTuple):
    """Rows that belong together, the numbers of what they belong to, and what is left over for the noise."""

    rows: np.ndarray
    cluster: np.ndarray
    zero: np.ndarray
    """Number `(rows,)` of the run whose zero is in the row; 0 of all where there are no zeros."""
    degrees_of_freedom: int
    """By component."""


def _clusters(measurement: Measurement, places: np.ndarray) -> np.ndarray:
    """Numbers `(n,)`: rows of one place that follow soon after one another."""
    time = measurement.state.time
    when, limit = (np.arange(len(places)), CLOSE_ROWS) if time is None else (time, CLOSE_S)
    order = np.lexsort((when, places))
    new = np.append(True, (np.diff(places[order]) != 0) | (np.diff(when[order]) > limit))
    result = np.empty(len(places), int)
    result[order] = np.cumsum(new) - 1
    return result


def _seen_again(measurement: Measurement, cluster: np.ndarray) -> _Again:
    """The rows whose cluster has several."""
    rows = np.flatnonzero(np.bincount(cluster)[cluster] > 1)
    _, number = np.unique(cluster[rows], return_inverse=True)
    zero = np.zeros(len(rows), int)
    if measurement.instrument.components == 1:
        _, zero = np.unique(measurement.groups[rows], return_inverse=True)
    if not len(rows):
        return _Again(rows, number, zero, 0)
    sizes = int(number.max()) + 1, int(zero.max()) + 1
    graph = coo_array((np.ones(len(rows)), (number, sizes[0] + zero)), shape=(sum(sizes), sum(sizes)))
    parts, _ = connected_components(graph, directed=False)
    unknown = sum(sizes) - parts if sizes[1] > 1 else sizes[0]
    return _Again(rows, number, zero, len(rows) - unknown)


def _judged(measurement: Measurement, again: _Again, places: np.ndarray, *, apart: bool) -> Repeats | None:
    """The noise in these rows, against the sheet."""
    if again.degrees_of_freedom < 1:
        return None
    own = measurement.rows(again.rows)
    left = _left_over(own, again)
    degrees_of_freedom = again.degrees_of_freedom * own.instrument.components
    chi2 = float(np.sum(whitened(whiteners(own), left) ** 2))
    p_value = 2.0 * min(float(special.chdtrc(degrees_of_freedom, chi2)), float(special.chdtr(degrees_of_freedom, chi2)))
    return Repeats(
        len(np.unique(places[again.rows])),
        degrees_of_freedom,
        chi2 / degrees_of_freedom,
        min(p_value, 1.0),
        _components(own, left, again.degrees_of_freedom),
        apart,
    )


def _left_over(measurement: Measurement, again: _Again) -> Array:
    """Observations `(rows, d)` less the mean of their cluster, and of their run's zero."""
    left = _less_mean(measurement.observed, again.cluster)
    if not again.zero.any():
        return left
    for _ in range(ROUNDS):
        before = left
        left = _less_mean(_less_mean(left, again.zero), again.cluster)
        if np.abs(left - before).max() <= SETTLED * np.abs(left).max():
            break
    return left


def _less_mean(values: Array, number: np.ndarray) -> Array:
    sums = np.zeros((int(number.max()) + 1, values.shape[1]))
    np.add.at(sums, number, values)
    return np.asarray(values - (sums / np.bincount(number)[:, None])[number])


def _components(measurement: Measurement, left: Array, degrees_of_freedom: int) -> tuple[Component, ...]:
    """Noise by direction; of the rows of linear and of rotary axes apart."""
    covariance = equations.covariance(measurement)
    share = degrees_of_freedom / len(left)
    if not isinstance(measurement.instrument, LaserTracker):
        names = ["deviation"] if measurement.instrument.components == 1 else list("xyz")[: left.shape[1]]
        micro = measurement.per_micro[:, 0]
        found = []
        for size, unit in ((1e3, "um"), (1e6, "urad")):
            rows = micro == size
            for k, name in enumerate(names) if rows.any() else ():
                noise, sheet = np.mean(left[rows, k] ** 2) / share, np.mean(covariance[rows, k, k])
                found.append(Component(name, unit, float(noise**0.5 * size), float(sheet**0.5 * size)))
        return tuple(found)
    frame = _beam_frame(measurement.observed)
    own, sheets = np.einsum("nij,nj->ni", frame, left), np.einsum("nij,njk,nik->ni", frame, covariance, frame)
    return tuple(
        Component(
            name,
            "um",
            float(np.sqrt(np.mean(own[:, k] ** 2) / share)) * 1e3,
            float(np.sqrt(np.mean(sheets[:, k]))) * 1e3,
        )
        for k, name in enumerate(("range", "azimuth", "elevation"))
    )


def _beam_frame(points: Array) -> Array:
    """Rows of rotations `(n, 3, 3)`: along the beam, across it to the left, and up; points `(n, 3)`."""
    beam = points / np.linalg.norm(points, axis=1, keepdims=True)
    left = np.cross([0.0, 0.0, 1.0], beam)
    size = np.linalg.norm(left, axis=1, keepdims=True)
    left = np.where(size > 1e-9, left / np.maximum(size, 1e-9), [0.0, 1.0, 0.0])
    return np.stack([beam, left, np.cross(beam, left)], axis=1)
