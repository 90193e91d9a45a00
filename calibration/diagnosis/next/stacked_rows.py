"""Rows of the data and of a follow-up design, one below the other, before the design is measured.

A design brings unknowns of its own: its registration, the drift of an instrument that was set up again, and the state
in which each cause that changes with time begins, since the pause before it is unknown. No size limits these.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from calibration.follow_up.design import FollowUpDesign
from calibration.gaussian_terms.noise import stops_of
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import ROUNDING
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.term import Term
from calibration.gaussian_terms.whitened import Whitener
from calibration.registration.registration import Registration
from kinematics.effects import Effect
from kinematics.error_model.effect_sums import Design
from kinematics.state import State
from kinematics.transforms import Array


@dataclass(frozen=True)
class StackedRows:
    """The data, as rows to which those of a design are added; all in standard deviations of the noise."""

    structure: Structure
    registration: Registration
    terms: Sequence[Term]
    """Those of the structure, then others that are compared with them."""
    recurring: Array
    """A function without a name `(n, d)`, mm and rad, that may recur with the position or with the time."""
    root: Array
    """Triangular rows with the products of the columns of the data, then of the registration."""

    @classmethod
    def of(
        cls, structure: Structure, registration: Registration, others: Sequence[Term], recurring: Array
    ) -> StackedRows:
        """The data of a structure; its terms and the others have columns at the rows of any design."""
        white, observations = structure.whitener, structure.data.observations
        terms = (*structure.terms, *others)
        columns = [structure.data.geometry.columns, *(term.columns for term in terms), *(recurring[:, :, None],) * 2]
        free = np.concatenate([white.rows(observations.registration), observations.stated])
        whole = np.concatenate([white.with_stated(np.concatenate(columns, axis=2)), free], axis=1)
        root = np.asarray(np.linalg.qr(whole / np.sqrt(structure.noise.factor), mode="r"), float)
        return cls(structure, registration, terms, recurring, root)

    @property
    def width(self) -> int:
        """Number of columns: of the geometry, of the terms, and of the function by position and by time."""
        return self.structure.data.geometry.width + sum(term.width for term in self.terms) + 2

    def products(self, design: FollowUpDesign | None = None) -> Array:
        """Products `(width, width)` of the columns, whatever the registration; with the rows of a design if given."""
        if design is None:
            return _products_beside(self.root[:, : self.width], self.root[:, self.width :])
        own, free = self._rows_of(design)
        names, known = design.registration.names, self.registration.names
        rows = np.zeros((len(self.root), free.shape[1]))
        rows[:, [names.index(name) for name in known]] = self.root[:, self.width :]
        return _products_beside(np.concatenate([self.root[:, : self.width], own]), np.concatenate([rows, free]))

    def _rows_of(self, design: FollowUpDesign) -> tuple[Array, Array]:
        """Columns of a design, and those of its unknowns, which are the registration and those of the design's own."""
        observations = _observations_of(design, self.structure.data.observations)
        measurement, geometry = observations.measurement, self.structure.data.geometry
        axes = measurement.moving
        repeats = {axis: size for axis, size in self.structure.noise.repeats.items() if axis in axes}
        noise = replace(self.structure.noise, repeats=repeats, left_out=np.zeros(len(observations), bool))
        white = Whitener.of(observations, stops_of(observations), noise)
        parts = [columns_after(observations, geometry.effects) @ geometry.parameters]
        parts += [_at(observations, term) for term in self.terms]
        parts += [self._again(design, len(observations))]
        free = [observations.registration, columns_after(observations, design.unknown), *self._begun(observations)]
        own, unknown = (white.rows(np.concatenate(each, axis=2)) for each in (parts, free))
        scale = np.sqrt(noise.factor * (1.0 + self._of_functions))
        lengths = np.pad(known_lengths(design), ((0, 0), (0, unknown.shape[1] - observations.registration.shape[2])))
        own = np.concatenate([own / scale, np.zeros((len(lengths), own.shape[1]))])
        return own, np.concatenate([unknown / scale, lengths])

    def _begun(self, observations: Observations) -> Iterator[Array]:
        """Columns of the terms that change with time, all rows at one time."""
        state = observations.measurement.state
        if state.time is None:
            return
        steady = replace(state, time=np.full_like(state.time, state.time.mean()), past=None)
        at_rest = replace(observations, measurement=replace(observations.measurement, state=steady))
        for term in self.terms:
            if term.named and any("time" in effect.needs for effect in term.effects):
                yield _at(at_rest, term)

    def _again(self, design: FollowUpDesign, rows: int) -> Array:
        """The function `(n, d, 2)` at the rows that a design repeats, and at the times since its start; else zero."""
        if design.again is None:
            return np.zeros((rows, self.recurring.shape[1], 2))
        return np.stack([self.recurring[design.again], self.recurring[self._at_the_same_time(design)]], axis=2)

    def _at_the_same_time(self, design: FollowUpDesign) -> np.ndarray:
        """Rows of the data at the times since the start of the rows of a design; without times in order."""
        assert design.again is not None
        repeated = np.sort(design.again)
        before, after = self.structure.data.observations.measurement.state.time, design.measurement.state.time
        if before is None or after is None:
            return repeated
        rows = np.arange(repeated[0], repeated[-1] + 1)
        since, elapsed = before[rows] - before[rows[0]], after - after.min()
        return np.asarray(rows[np.searchsorted((since[1:] + since[:-1]) / 2.0, elapsed)])

    @property
    def _of_functions(self) -> float:
        """Mean square of the functions without a name, in the variance of the noise: at other rows they are noise."""
        structure = self.structure
        width = structure.data.geometry.width
        named = np.array([term.named for term in structure.terms for _ in range(term.width)], bool)
        moved = structure.explained(~np.append(np.ones(width, bool), named))
        return float(np.mean(moved**2)) / structure.noise.factor


def _products_beside(columns: Array, free: Array) -> Array:
    """Products of columns less what any combination of the free ones explains."""
    length = np.linalg.norm(free, axis=0)
    spanned, values, _ = np.linalg.svd(free / np.where(length > 0.0, length, 1.0), full_matrices=False)
    spanned = spanned[:, values > ROUNDING * values.max(initial=0.0)]
    left = columns - spanned @ (spanned.T @ columns)
    return np.asarray(left.T @ left)


def _at(observations: Observations, term: Term) -> Array:
    """Columns `(n, d, width)` of a term at the rows of a design; zero for functions without a name."""
    if not term.named or term.parameters is None:
        return np.zeros((len(observations), observations.components, term.width))
    linear = np.concatenate([effect.linear for effect in term.effects])
    return np.asarray(columns_after(observations, term.effects)[:, :, linear] @ term.parameters)


def columns_after(observations: Observations, effects: Sequence[Effect]) -> Array:
    """Derivatives `(n, d, k)` by the parameters of effects at the rows of a design, which continue the rows before."""
    measurement = observations.measurement
    before, state = measurement.state.past, measurement.state
    if before is None:
        return observations.columns(effects)
    whole = Design(effects, measurement.machine, _one_after_the_other(before, state), with_instrument=True)
    return whole.of(np.arange(len(before), len(before) + len(state)), observations.transform)


def _one_after_the_other(before: State, after: State) -> State:
    """Two states as one; a column that the first one does not have begins as in the second one."""
    columns: dict[str, Any] = {}
    for field in fields(State):
        own = getattr(after, field.name, None)
        if field.init and isinstance(own, np.ndarray):
            first = getattr(before, field.name)
            columns[field.name] = np.concatenate([np.repeat(own[:1], len(before), 0) if first is None else first, own])
    warm = {name: np.concatenate([before.temperatures[name], own]) for name, own in after.temperatures.items()}
    return State(**columns, temperatures=warm)


def _observations_of(design: FollowUpDesign, before: Observations) -> Observations:
    """The rows of a design, of a machine without errors."""
    measurement, registration = design.measurement, design.registration
    instrument, rows = measurement.instrument, len(measurement)
    own = instrument.registration_design(measurement, registration)
    return Observations(
        measurement,
        np.zeros((rows, before.components)),
        instrument.transform(measurement, registration),
        own,
        measurement.specified_covariances,
        np.zeros((0, own.shape[2])),
        np.zeros(0),
        np.ones(rows, int),
        before.given,
    )


def known_lengths(design: FollowUpDesign) -> Array:
    """Derivatives `(lengths, registration)` of the known distances of a design, in their standard uncertainties."""
    names = design.registration.names
    rows = np.zeros((len(design.lengths), len(names)))
    for row, length in zip(rows, design.lengths, strict=True):
        one, other = design.registration.targets[length.one], design.registration.targets[length.other]
        along = (other - one) / np.linalg.norm(other - one) / length.u_mm
        for k, letter in enumerate("xyz"):
            row[names.index(f"target {length.one} {letter}")] = -along[k]
            row[names.index(f"target {length.other} {letter}")] = along[k]
    return rows
