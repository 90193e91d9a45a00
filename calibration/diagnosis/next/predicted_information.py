"""Information on causes in the data, and with one more measurement before it is made: to first order.

K has the whitened columns of the model, of the causes in question and of the registration; K'K of the data and of a
planned measurement add up. The information on a cause with columns G is S = G'G - G'B (B'B + priors)^-1 B'G, with any
others B fitted too. A signal of size a has the non-centrality a' S a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calibration.diagnosis.next.follow_up import FollowUpDesign
from calibration.diagnosis.search.linearised_fit import GENEROUS, RIDGE, LinearisedFit, derivatives, signals
from calibration.fit.linear import Posterior
from calibration.observation import equations
from calibration.observation.normal_equations import whiteners
from kinematics.effects import Effect
from kinematics.transforms import Array


@dataclass(frozen=True)
class Information:
    """K'K and the priors' part, columns in the order model, causes, registration."""

    matrix: Array
    """`(w, w)`"""
    limited: Array
    """Diagonal `(w,)` of the priors' part."""
    causes: tuple[slice, ...]
    """Columns of each cause."""
    scalars: int
    _schur: dict[tuple[object, ...], Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def schur(self, cause: int, beside: int | None = None, without: slice | None = None) -> Array:
        """Schur complement `(k, k)` of a cause, with another fitted `beside` it, the model `without` some columns."""
        key = (beside, None if without is None else (without.start, without.stop))
        first, last = self.causes[0].start, self.causes[-1].stop
        if key not in self._schur:
            fitted = np.ones(len(self.limited), bool)
            fitted[first:last] = False
            if without is not None:
                fitted[without] = False
            if beside is not None:
                fitted[self.causes[beside]] = True
            posterior, chosen = Posterior(self.matrix[np.ix_(fitted, fitted)], self.limited[fitted]), slice(first, last)
            self._schur[key] = posterior.complement(self.matrix[chosen, chosen], self.matrix[fitted, chosen])
        own = slice(self.causes[cause].start - first, self.causes[cause].stop - first)
        return np.asarray(self._schur[key][own, own])

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

    @property
    def now(self) -> Information:
        """Information in the data."""
        linearised, registered = self.linearised, len(self._lengths)
        own, by_model = linearised.design[:, :registered], linearised.design[:, registered:]
        columns = signals(linearised.measurement, linearised.rows, self.effects, linearised.transform)
        whole = np.concatenate([by_model, columns, own], axis=1)
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
        if follow_up.unknown:
            drift = signals(more, rows, follow_up.unknown, parts.transform)
            own = np.concatenate([own, _padded(drift, len(follow_up.lengths))], axis=1)
        length = np.linalg.norm(own, axis=0)
        length[: len(known)] = self._lengths
        own = own / np.where(length > 0.0, length, 1.0)
        columns = np.concatenate([parts.by_model, signals(more, rows, self.effects, parts.transform)], axis=1)
        whole = np.concatenate([_padded(columns, len(follow_up.lengths)), own], axis=1)
        matrix = whole.T @ whole
        matrix[: len(now.matrix), : len(now.matrix)] += now.matrix
        return self._known(matrix, now.scalars + len(whole))

    def _known(self, matrix: Array, scalars: int) -> Information:
        registered = len(self._lengths)
        model = self.linearised.limited[registered:]
        ends = len(model) + np.cumsum([0, *(sum(q.linear for q in e.parameter_table) for e in self.effects)])
        causes = tuple(slice(low, high) for low, high in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
        limited = np.full(len(matrix), RIDGE)
        limited[: len(model)] = model
        limited[len(model) : ends[-1]] = GENEROUS**-2
        return Information(matrix, limited, causes, scalars)

    @cached_property
    def _lengths(self) -> Array:
        """Lengths of the registration's columns, by which the linearised fit scales them."""
        some = self.linearised.measurement.rows(self.linearised.rows)
        own = self.linearised.white @ equations.registration_design(some, self.linearised.fit.registration)
        return np.asarray(np.linalg.norm(own.reshape(self.linearised.scalars, -1), axis=0))


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
