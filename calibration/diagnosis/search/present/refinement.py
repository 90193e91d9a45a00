"""Refinement of a calibration by new data: finer error motions of its axes, with a prior that the evidence chooses.

The calibration of an earlier measurement has two faults that its covariance does not contain: its bases are too coarse
for errors that were hidden in the noise, and the machine may have changed a little. Both are error motions of the same
axes in nested bases (`nested_bases`), with a prior about zero. Basis and size of the prior are those of the greatest
evidence of the new data, axis by axis, beside changes that have a name: scales, location errors, causes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple, cast

import msgspec
import numpy as np

from calibration.cores import each
from calibration.diagnosis.search.derivatives import signals
from calibration.fit.fit import DOUBTFUL_P, Fit
from calibration.fit.linear import NormalBlocks, Part, of_columns
from calibration.fit.problem import solution
from calibration.gaussian_terms.given.nested_bases import refined
from calibration.measurement.measurement import Measurement
from calibration.observation.mean_lines import arms_of, centred
from calibration.observation.normal_equations import NormalEquations, decorrelation_of, residuals, whitened, whiteners
from calibration.observation.stops_and_lines import whole_stops
from kinematics.effects import Effect, ErrorMotion
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array, read_only

LEVELS = (0, 1, 2)
"""Times that a basis is refined."""
FINEST = 24
"""Most parameters of a refined error motion of a linear axis; finer errors are named as causes."""
SCALES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Sizes of the added error motions that are tried, as multiples of the typical ones."""
ROWS = 5000
"""Largest number of rows in the evidence: whole stops, evenly spread."""
WIDE = 10.0
"""Prior standard deviation of changes that have a name, in typical sizes."""
REGISTRATION, PRESENT, BESIDES = ("", "registration"), ("", "present"), ("", "besides")


class Added(NamedTuple):
    """Error motions of an axis that are added to those of a calibration."""

    level: int
    """Times that the bases of the calibration are refined."""
    scale: float
    """Prior standard deviation of their parameters, in typical sizes; 0: none are added."""


Refinement = Mapping[str, Added]
"""By axis."""
GENEROUS = Added(1, 0.2)
"""Refinement of each axis in the fit at which the evidence is linearised."""


def added(measurement: Measurement, calibration: ErrorModel, axis: str, level: int) -> list[ErrorMotion]:
    """The error motions of an axis, at zero, in bases of the calibration that are refined `level` times.

    None where a basis of a linear axis would be finer than `FINEST` or than the positions of the data.
    """
    found = []
    for effect, _ in calibration.error_motions:
        if effect.axis != axis:
            continue
        basis = effect.basis
        for _ in range(level):
            basis = refined(basis)
        zero = (0.0,) * basis.size
        found.append(ErrorMotion(effect.component, axis, basis, zero, u=zero))
    most = min(FINEST, measurement.distinct_positions[axis])
    if level and any(effect.basis.size > most for effect in found):
        return []
    return cast(list[ErrorMotion], list(centred(found, arms_of(measurement))))


def chosen(found: Fit, present: ErrorModel, root: Array, besides: Sequence[Effect]) -> Refinement:
    """The refinement of the greatest evidence, by axis.

    found: the evidence is linear about this fit. present: the calibration with the changes that are fitted with it, all
    at their start, with a root `(p, p)` of its prior covariance. besides: changes with a name, free in the evidence.
    """
    evidence = _Evidence(found, present, root, besides)
    axes = {motion.axis: None for motion, _ in present.error_motions}
    levels = {axis: [n for n in LEVELS if added(found.measurement, present, axis, n)] for axis in axes}
    best: dict[str, Added] = {axis: Added(own[-1], SCALES[2]) for axis, own in levels.items() if own}
    while True:
        before = dict(best)
        for axis in best:
            variants = [best | {axis: Added(0, 0.0)}]
            variants += [best | {axis: Added(level, scale)} for level in levels[axis] for scale in SCALES[1:]]
            values = each(evidence.of, variants)
            best = variants[int(np.argmax(values))]
        if best == before:
            return best


class _Evidence:
    """Log marginal likelihood of refinements, up to a constant of the data, to first order about a fit."""

    def __init__(self, found: Fit, present: ErrorModel, root: Array, besides: Sequence[Effect]) -> None:
        self._measurement, self._registration = found.measurement, found.registration
        self._present, self._root, self._besides = present, root, besides
        rows = np.flatnonzero(found.kept)
        self._rows = rows[whole_stops(found.measurement.stops[rows], ROWS)] if len(rows) > ROWS else rows
        some = found.measurement.rows(self._rows)
        white = whiteners(some)
        self._decorrelation = decorrelation_of(some)
        self._white = white / np.sqrt(found.variance_factor if found.p_value < DOUBTFUL_P else 1.0)
        self._transform = self._white @ some.instrument.transform(some, found.registration)
        left = residuals(found.measurement, present, found.registration)[self._rows]
        self._residual = self._decorrelation.apply(whitened(self._white, left)).reshape(-1)
        self._columns = cache(self._made)
        self._blocks = NormalBlocks(of_columns(self._columns))

    def of(self, refinement: Refinement) -> float:
        """The evidence of a refinement."""
        used = {axis: own for axis, own in refinement.items() if own.scale}
        axes: list[Part] = [(axis, str(own.level)) for axis, own in used.items()]
        parts = [REGISTRATION, PRESENT, BESIDES, *axes]
        right = np.concatenate([self._residual @ self._columns(part) for part in parts])
        normal = NormalEquations(self._blocks.matrix(parts), right)
        normal.add_stated(self._measurement, self._registration)
        widths = [self._columns(part).shape[1] for part in parts[1:]]
        prior = np.repeat([1.0, WIDE, *(own.scale for own in used.values())], widths)
        solved = solution(normal, self._registration, prior, np.zeros(len(prior)))
        return -0.5 * (solved.log_determinant - solved.reduction)

    def _made(self, part: Part) -> Array:
        """Whitened columns `(N, k)`: of the calibration in units of its prior, of others in typical sizes."""
        n = len(self._rows)
        if part == REGISTRATION:
            some = self._measurement.rows(self._rows)
            columns = self._white @ some.instrument.registration_design(some, self._registration)
        elif part == PRESENT:
            machine, state = self._measurement.machine, self._measurement.state
            design = Design(self._present.effects, machine, state, with_instrument=True)
            columns = design.of(self._rows, self._transform) @ self._root
        else:
            axis, level = part
            effects: Sequence[Effect] = self._besides
            if part != BESIDES:
                effects = added(self._measurement, self._present, axis, int(level))
            columns = signals(self._measurement, self._rows, effects, self._transform)
            columns = columns.reshape(n, self._measurement.components, -1)
        return read_only(np.asarray(self._decorrelation.apply(columns).reshape(len(self._residual), -1)))


def with_more(model: ErrorModel, effects: Sequence[Effect]) -> ErrorModel:
    """The model with further effects and without covariance."""
    return msgspec.structs.replace(model, effects=(*model.effects, *effects), covariance=None)
