"""Power of the data to show a hidden effect: the Fisher information of the true effect beside everything unknown.

Unknown are the noise, the non-repeatability, the pose of the tracker, and the errors of the axes, with the covariance
of the geometry from which they are drawn. No diagnosis knows this covariance: the power is an upper limit. A worn spot
is an error of one axis that depends on its position alone, which every calibration holds: beside any such error it has
no power, and no cause is missing.
"""

from __future__ import annotations

import copy

import numpy as np
from scipy.stats import ncx2

from short_measurements.case import TARGETS, UM, Case, arms
from short_measurements.machines import Array, Geometry

DRAWS = 1000
"""Geometries whose signals are the covariance of the errors of the axes."""
FREE_UM = 1e5
"""Standard deviation of unknowns without any prior knowledge."""
ROUNDED = 0.01 * UM / 12**0.5
"""Standard deviation of readings that are written in steps of 0.01 um, mm."""
SURE = 10.0
"""BIC of an effect that is named: odds of 150."""
PARAMETERS = {
    "backlash": 1,
    "growth with temperature": 2,
    "growth with time": 3,
    "pitch": 3,
    "crash": 2,
    "drift": 4,
    "knock": 7,
    "station drift": 6,
    "swapped targets": 3,
    "random walk": 1,
    "worn spot": 3,
    "sag": 3,
    "stick-slip": 1,
}
"""Unknown parameters of an effect, with its moment, time constant, period or position."""


def power(case: Case) -> float:
    """Chance that the evidence of the true effect exceeds odds of 150; 0 where nothing is hidden."""
    if case.effect == "none":
        return 0.0
    free = PARAMETERS[case.effect]
    needed = SURE + free * np.log(3 * len(case.rows.q))
    return float(ncx2.sf(needed, free, max(information(case), 1e-9)))


def information(case: Case) -> float:
    """Increase of chi2 without the true effect, the best of everything unknown in its place."""
    signal = _white(case, _signal(case)[:, :, None])[:, 0]
    unknown = _unknown(case)
    covariance = np.eye(len(signal)) + unknown @ unknown.T
    return float(signal @ np.linalg.solve(covariance, signal))


def _signal(case: Case) -> Array:
    """Readings `(n, 3)` with the effect less those without it, free of noise, mm."""
    with_it = copy.copy(case)
    with_it.noise, with_it.repeats_um = np.zeros_like(case.noise), 0.0
    without = copy.copy(with_it)
    without.effect = "none"
    moved = with_it.readings() - without.readings()
    names = list(TARGETS)[: case.plan.targets]
    if case.effect == "swapped targets" and len(names) > 1:
        arm, rows = arms(case.rows), case.wrong
        others = np.array([TARGETS[names[(names.index(name) + 1) % len(names)]] for name in case.rows.target[rows]])
        moved[rows] += (others - arm[rows]) @ case.frame
    return np.asarray(moved)


def _unknown(case: Case) -> Array:
    """White signals `(3n, k)` of everything unknown, each of one standard deviation."""
    rng, q, n = np.random.default_rng(0), case.rows.q, len(case.rows.q)
    nominal = case.nominal(case.rows)
    drawn = (Geometry(case.of, rng).errors(q) for _ in range(DRAWS))
    shapes = [(case.of.points(q, errors, arms(case.rows)) - nominal) @ case.frame for errors in drawn]
    seen = (nominal - case.origin) @ case.frame
    turns = np.stack([np.cross(e, seen) for e in np.eye(3)], axis=2) / np.linalg.norm(seen, axis=1).mean()
    pose = np.concatenate([np.repeat(np.eye(3)[None], n, axis=0), turns], axis=2)
    parts = [np.moveaxis(np.array(shapes), 0, 2) / DRAWS**0.5, FREE_UM * UM * pose]
    stops = np.eye(case.stop[-1] + 1)[case.stop]
    for k in range(3) if case.repeats_um else ():
        parts.append(case.repeats_um * UM * case.frame[k][None, :, None] * stops[:, None, :])
    if case.effect == "worn spot":
        positions = np.unique(q[:, case.axis], return_inverse=True)[1].reshape(-1)
        own = np.eye(positions.max() + 1)[positions]
        parts.append(FREE_UM * UM * case.frame[case.axis][None, :, None] * own[:, None, :])
    return np.concatenate([_white(case, part) for part in parts], axis=1)


def _white(case: Case, signals: Array) -> Array:
    """Signals `(n, 3, k)` in the tracker's frame in units of its true noise, `(3n, k)`."""
    seen = (case.nominal(case.rows) - case.origin) @ case.frame
    length = np.linalg.norm(seen, axis=1)
    beam = seen / length[:, None]
    level = np.cross([0.0, 0.0, 1.0], beam)
    level /= np.linalg.norm(level, axis=1)[:, None]
    axes = np.stack([beam, level, np.cross(beam, level)], axis=1)
    noise = [(base + slope * length / 1000) * UM for base, slope in (case.range_um, case.across_um)]
    u = np.sqrt(np.stack([noise[0], noise[1], noise[1]], axis=1) ** 2 + ROUNDED**2)
    return np.asarray((np.einsum("nij,njk->nik", axes, signals) / u[:, :, None]).reshape(3 * len(u), -1))
