"""Information on causes in the data, and with one more measurement before it is made: to first order.

K has the whitened columns of the model, of the causes in question and of the registration; K'K of the data and of a
planned measurement add up. The information on causes with columns G is S = G'G - G'B (B'B + priors)^-1 B'G, with model
and registration B fitted too. A signal of size a has the non-centrality a' S a. Beside another cause j, whose size is
free, S_ii - S_ij S_jj^+ S_ji is left of it: nothing where both have parallel columns.

A planned measurement brings unknowns of its own: its registration, the drift of an instrument that was set up again,
and the state in which each cause that changes with time begins, since the pause before it is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calibration.diagnosis.next.unexplained_shape import UnexplainedShape
from calibration.diagnosis.search.derivatives import derivatives, signals
from calibration.diagnosis.search.linearised_fit import RIDGE, LinearisedFit
from calibration.fit.linear import Posterior, pseudo_inverse
from calibration.follow_up.design import FollowUpDesign
from calibration.measurement.measurement import Measurement
from calibration.observation.normal_equations import whiteners
from kinematics.effects import Effect
from kinematics.transforms import Array

PARALLEL = 1e-9
"""Share of the largest eigenvalue of the information below which a combination of columns counts as parallel."""


@dataclass(frozen=True)
class Information:
    """K'K and the priors' part, columns in the order model, causes, registration."""

    matrix: Array
    """`(w, w)`"""
    limited: Array
    """Diagonal `(w,)` of the priors' part."""
    causes: tuple[slice, ...]
    """Columns of each cause."""
    begun: tuple[slice, ...]
    """Columns of the unknown state of each cause at the beginning of a planned measurement; they follow the causes."""
    scalars: int
    _schur: dict[tuple[int, int] | None, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def schur(self, cause: int, beside: int | None = None, without: slice | None = None) -> Array:
        """Schur complement `(k, k)` of a cause, with another fitted `beside` it, the model `without` some columns."""
        whole, own = self._of_causes(without), self._own(self.causes[cause])
        fitted = [self._own(self.begun[cause])]
        if beside is not None:
            fitted += [self._own(self.causes[beside]), self._own(self.begun[beside])]
        others = np.concatenate([np.arange(part.start, part.stop) for part in fitted])
        root = pseudo_inverse(whole[np.ix_(others, others)], PARALLEL).root
        shared = root.T @ whole[others, own]
        return np.asarray(whole[own, own] - shared.T @ shared)

    def _of_causes(self, without: slice | None) -> Array:
        """Schur complement of the columns of all causes and of their beginnings."""
        key = None if without is None else (without.start, without.stop)
        if key not in self._schur:
            chosen = slice(self.causes[0].start, self.begun[-1].stop)
            fitted = np.ones(len(self.limited), bool)
            fitted[chosen] = False
            if without is not None:
                fitted[without] = False
            posterior = Posterior(self.matrix[np.ix_(fitted, fitted)], self.limited[fitted])
            self._schur[key] = posterior.complement(self.matrix[chosen, chosen], self.matrix[fitted, chosen])
        return self._schur[key]

    def _own(self, columns: slice) -> slice:
        first = self.causes[0].start
        return slice(columns.start - first, columns.stop - first)

    def squares(self, cause: int, size: Array) -> float:
        """Sum of squares of a signal of a given size; 0 for one that changes with time, whose origin is arbitrary."""
        own, begun = self.causes[cause], self.begun[cause]
        return float(size @ self.matrix[own, own] @ size) if begun.start == begun.stop else 0.0

    def share(self, cause: int) -> float:
        """Share of a cause's signal that model and registration cannot imitate."""
        own = self.causes[cause]
        whole = float(np.trace(self.matrix[own, own]))
        return float(np.sqrt(max(np.trace(self.schur(cause)), 0.0) / whole)) if whole > 0.0 else 0.0


@dataclass(frozen=True)
class PredictedInformation:
    """The linearised fit of the data, and the causes in question."""

    linearised: LinearisedFit
    effects: Sequence[Effect]
    unexplained: UnexplainedShape | None = None
    """A shape that no cause explains, as two more causes: recurring with the position, and with the time."""

    @property
    def now(self) -> Information:
        """Information in the data."""
        linearised, registered = self.linearised, len(self._lengths)
        own, by_model = linearised.design[:, :registered], linearised.design[:, registered:]
        columns = signals(linearised.measurement, linearised.rows, self.effects, linearised.transform)
        shapes = [] if self.unexplained is None else [self.unexplained.now(linearised)]
        begun = np.zeros((len(columns), sum(self._widths[1])))
        whole = np.concatenate([by_model, columns, *shapes, begun, own], axis=1)
        return self._known(whole.T @ whole, linearised.scalars)

    def after(self, now: Information, follow_up: FollowUpDesign) -> Information:
        """Information in the data and a planned measurement."""
        fit, more = self.linearised.fit, follow_up.measurement
        white = whiteners(more) / np.sqrt(fit.variance_factor)
        rows = np.arange(len(more))
        parts = derivatives(fit, more, rows, follow_up.registration, white)
        known, names = fit.registration.names, follow_up.registration.names
        order = [names.index(name) for name in known] + [i for i, name in enumerate(names) if name not in set(known)]
        own = np.concatenate([parts.own, _lengths_known(follow_up, names)])[:, order]
        steady, model = _at_mean_time(more), fit.model.effects
        begun = signals(steady, rows, [effect for effect in model if _in_time(effect)], parts.transform)
        drift = signals(more, rows, follow_up.unknown, parts.transform)
        own = np.concatenate([own, _padded(np.concatenate([begun, drift], axis=1), len(follow_up.lengths))], axis=1)
        length = np.linalg.norm(own, axis=0)
        length[: len(known)] = self._lengths
        own = own / np.where(length > 0.0, length, 1.0)
        parted = [parts.by_model, signals(more, rows, self.effects, parts.transform)]
        parted += [] if self.unexplained is None else [self.unexplained.after(follow_up, white)]
        parted += [signals(steady, rows, [effect for effect in self.effects if _in_time(effect)], parts.transform)]
        columns = np.concatenate(parted, axis=1)
        whole = np.concatenate([_padded(columns, len(follow_up.lengths)), own], axis=1)
        matrix = whole.T @ whole
        matrix[: len(now.matrix), : len(now.matrix)] += now.matrix
        return self._known(matrix, now.scalars + len(whole))

    def _known(self, matrix: Array, scalars: int) -> Information:
        registered = len(self._lengths)
        model = self.linearised.limited[registered:]
        own, begun = self._widths
        ends = (len(model) + np.cumsum([0, *own, *begun])).tolist()
        parts = tuple(slice(low, high) for low, high in pairwise(ends))
        limited = np.full(len(matrix), RIDGE)
        limited[: len(model)] = model
        return Information(matrix, limited, parts[: len(own)], parts[len(own) :], scalars)

    @cached_property
    def _widths(self) -> tuple[list[int], list[int]]:
        """Numbers of columns of each cause, and of its unknown state at the beginning of a planned measurement."""
        own = [sum(quantity.linear for quantity in effect.parameter_table) for effect in self.effects]
        begun = [width * _in_time(effect) for width, effect in zip(own, self.effects, strict=True)]
        shapes = 0 if self.unexplained is None else 2
        return own + [1] * shapes, begun + [0] * shapes

    @cached_property
    def _lengths(self) -> Array:
        """Lengths of the registration's columns, by which the linearised fit scales them."""
        some = self.linearised.measurement.rows(self.linearised.rows)
        own = self.linearised.white @ some.instrument.registration_design(some, self.linearised.fit.registration)
        return np.asarray(np.linalg.norm(own.reshape(self.linearised.scalars, -1), axis=0))


def _in_time(effect: Effect) -> bool:
    """True for a cause that changes with time."""
    return "time" in effect.needs


def _at_mean_time(measurement: Measurement) -> Measurement:
    """The measurement with all its rows at one time."""
    state = measurement.state
    if state.time is None:
        return measurement
    return replace(measurement, state=replace(state, time=np.full_like(state.time, state.time.mean())))


def _padded(columns: Array, rows: int) -> Array:
    """The columns with rows of zeros below."""
    return np.pad(columns, ((0, rows), (0, 0)))


def _lengths_known(follow_up: FollowUpDesign, names: list[str]) -> Array:
    """Whitened derivatives `(lengths, registration)` of the known distances."""
    rows = np.zeros((len(follow_up.lengths), len(names)))
    for row, length in zip(rows, follow_up.lengths, strict=True):
        one, other = follow_up.registration.targets[length.one], follow_up.registration.targets[length.other]
        along = (other - one) / np.linalg.norm(other - one) / length.u_mm
        for k, letter in enumerate("xyz"):
            row[names.index(f"target {length.one} {letter}")] = -along[k]
            row[names.index(f"target {length.other} {letter}")] = along[k]
    return rows
