"""A structure: the terms that are present, with the sizes and the noise that are likeliest for them.

Everything is found together: sizes of bands and terms by fixed-point steps (MacKay 1992), the noise by restricted
likelihood, outliers by their odds. `total` is the log posterior of the structure up to a constant of the data: the one
number by which structures are compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import blas

from calibration.gaussian_terms.geometry import NOTHING, SETTLED_SIZE, Asked, Geometry, geometry, stepped, summed
from calibration.gaussian_terms.noise import Moments, Noise, Stops, stops_of, variances
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.outliers import outlying
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.gaussian_terms.term import Term
from calibration.gaussian_terms.whitened import Whitener
from kinematics.error_model.priors import SIZES_IN_TYPICAL, Priors
from kinematics.transforms import Array

SIZE_STEPS, FURTHER_STEPS = 12, 4
"""Most steps of the sizes: after a change of the terms, and of the noise."""
MOST_STRUCTURE_ROUNDS = 8
"""Most rounds of sizes, noise and outliers."""
SAME_FACTOR, SAME_REPEATS = 0.03, 0.1
"""Relative changes of the variance factor, and of the non-repeatability, below which the noise is found."""
CLEAR_LOG_ODDS = 5.0
"""Log odds from which something is clear: 150 to 1, strong evidence by the scale of Kass and Raftery."""
LEAST_REPEATABILITY_UM = 0.5
"""Non-repeatability, um or urad, whose relative change counts in full."""


@dataclass(frozen=True)
class Data:
    """What all structures have in common: observations, geometry, stops."""

    observations: Observations
    geometry: Geometry
    stops: Sequence[Stops]
    gross: np.ndarray
    """True `(n,)` for rows with gross errors, far beyond any error of a machine."""
    least_factor: float
    """Least factor of the noise; 1 where nothing below the specification is to be explained."""
    asked: Asked = NOTHING
    """What a user states."""

    @classmethod
    def of(cls, observations: Observations, always: Geometry | None = None, asked: Asked = NOTHING) -> Data:
        """The data of observations; always: columns that are always present, by default all error motions."""
        _, trusted = observations.measurement.first_registration
        always = geometry(observations, asked) if always is None else always
        least = observations.priors.least_noise**2
        return cls(observations, always, stops_of(observations), ~trusted, least, asked)


@dataclass(frozen=True)
class Structure:
    """Terms, sizes and noise."""

    data: Data
    noise: Noise
    band_sizes: Array
    """Sizes of the bands of the geometry, in prior sizes."""
    terms: tuple[Term, ...] = ()
    term_sizes: tuple[float, ...] = ()
    """Sizes of the terms, in prior sizes."""

    @classmethod
    def first(cls, data: Data) -> Structure:
        """The geometry alone, before any fit, without the rows with gross errors."""
        return cls(data, Noise(left_out=data.gross), data.geometry.first_sizes)

    @property
    def priors(self) -> Priors:
        """What is known before any data."""
        return self.data.observations.priors

    @cached_property
    def whitener(self) -> Whitener:
        """The whitener of the noise."""
        return Whitener.of(self.data.observations, self.data.stops, self.noise)

    @cached_property
    def of_geometry(self) -> Equations:
        """Products of the columns of the geometry."""
        return self.whitener.equations(self.data.geometry.columns, self.registers)

    @cached_property
    def equations(self) -> Equations:
        """Products of the columns of the geometry, then of each term."""
        if not self.terms:
            return self.of_geometry
        return self.of_geometry.beside(self.whitener.through(self.data.geometry.columns, self.of_terms), self.of_terms)

    @cached_property
    def of_terms(self) -> Array:
        """Whitened columns `(N, a)` of the terms, one after the other."""
        ends = np.cumsum([term.width for term in self.terms])
        found = np.empty((len(self.whitener.spanned), ends[-1] if len(ends) else 0))
        for term, end in zip(self.terms, ends, strict=True):
            found[:, end - term.width : end] = self.whitener.columns(term.columns)
        return found

    @property
    def columns(self) -> list[Array]:
        """Columns `(n, d, ...)` of the geometry, then of each term."""
        return [self.data.geometry.columns, *(term.columns for term in self.terms)]

    @property
    def whitened(self) -> Array:
        """The whitened columns `(N, p)`."""
        return np.concatenate([self.whitener.columns(table) for table in self.columns], axis=1)

    @cached_property
    def registers(self) -> Array:
        """Products `(r, p)` of the directions of the registration with the whitened columns of the geometry."""
        return self.whitener.registers(self.data.geometry.columns)

    def explained(self, columns: np.ndarray | slice = slice(None)) -> Array:
        """What some columns explain of the whitened observations, by the mean of the posterior: `(N,)`."""
        coefficients = np.zeros(len(self.sizes))
        coefficients[columns] = self.posterior.mean[columns]
        ends = np.cumsum([table.shape[2] for table in self.columns])[:-1]
        pairs = zip(self.columns, np.split(coefficients, ends), strict=True)
        return self.whitener.columns(sum(table @ own for table, own in pairs)[:, :, None])[:, 0]  # type: ignore[index]

    def through(self, columns: Array) -> Array:
        """Products `(p, c)` of the columns that are present with others, whitened `(N, c)`."""
        return np.concatenate([self.whitener.through(table, columns) for table in self.columns])

    def by_term(self, rows: Array) -> dict[Term, Array]:
        """Rows `(a, ...)` of the columns of the terms, by these."""
        ends = np.cumsum([term.width for term in self.terms])[:-1]
        return dict(zip(self.terms, np.split(rows, ends), strict=True)) if self.terms else {}

    @cached_property
    def posterior(self) -> Posterior:
        """The posterior of all coefficients."""
        return Posterior.of(self.equations, self.sizes, self.noise.factor)

    @cached_property
    def over_sizes(self) -> Posterior:
        """The posterior with the uncertainty of the sizes of the bands: the mean is that of the likeliest sizes.

        A squared size with m determined coefficients, and those of its prior, has an inverse gamma distribution: its
        mean is larger than its likeliest value.
        """
        return replace(self.wider.posterior, mean=self.posterior.mean)

    @property
    def wider(self) -> Structure:
        """The structure with the mean squares of the sizes of the bands, instead of the likeliest ones."""
        bands = len(self.band_sizes)
        determined = summed(self.groups, self.posterior.determined, bands)[:bands]
        larger = self.data.geometry.wider(determined, self.priors)
        return self.resized(np.concatenate([self.band_sizes * larger, self.term_sizes]))

    @cached_property
    def not_repeating(self) -> dict[str, float]:
        """Standard deviation of each axis from stop to stop, um or urad, where the data show it clearly."""
        found = {}
        for axis, size in self.noise.repeats.items():
            others = {name: own for name, own in self.noise.repeats.items() if name != axis}
            without = replace(self, noise=replace(self.noise, repeats=others))
            if self.total - without.total > CLEAR_LOG_ODDS:
                found[axis] = size
        return found

    @property
    def groups(self) -> np.ndarray:
        """Number `(p,)` of the size of each column: those of the bands, then those of the terms."""
        bands = len(self.band_sizes)
        own = [np.full(term.width, bands + i) for i, term in enumerate(self.terms)]
        return np.asarray(np.concatenate([self.data.geometry.bands, *own]).astype(int))

    def columns_of(self, number: int) -> np.ndarray:
        """Numbers of the columns of one of the terms."""
        return np.flatnonzero(self.groups == len(self.band_sizes) + number)

    @property
    def sizes(self) -> Array:
        """Prior size `(p,)` of each column."""
        return np.asarray(np.concatenate([self.band_sizes, self.term_sizes])[self.groups])

    @property
    def log_evidence(self) -> float:
        """Log density of the observations, given the sizes and the noise."""
        posterior, white = self.posterior, self.whitener
        scale = white.scalars * float(np.log(self.noise.factor))
        lost = self.priors.left_out * np.count_nonzero(self.noise.left_out)
        return white.log_volume - 0.5 * (posterior.misfit + posterior.log_determinant + scale) - float(lost)

    @property
    def total(self) -> float:
        """Log posterior: evidence, prior of the sizes and of the noise, and prior odds of the terms."""
        about, squares = self._expected_squares[: len(self.band_sizes)], self.band_sizes**2
        fitted = ~self.data.geometry.fixed
        ratio = (about / squares)[fitted]
        of_sizes = -0.5 * self.priors.band_weight * float(np.sum(ratio - 1.0 - np.log(ratio)))
        of_terms = sum(term.log_prior for term in self.terms) + self._log_widths
        return self.log_evidence + of_sizes + self.log_noise_prior + of_terms

    @property
    def log_noise_prior(self) -> float:
        """Log density of the non-repeatabilities before any data (half-Cauchy)."""
        typical = self.priors.non_repeatability_um
        return -sum(float(np.log1p((size / typical) ** 2)) for size in self.noise.repeats.values())

    @property
    def _log_widths(self) -> float:
        """Log of the share of the prior of each term's size that the data leave (Laplace), all terms together.

        The logarithm of a size is as likely anywhere over the range of `SIZES_IN_TYPICAL`; m determined coefficients
        leave it a variance of 1 / (2 m).
        """
        if not self.terms:
            return 0.0
        determined = np.bincount(self.groups, self.posterior.determined)[len(self.band_sizes) :]
        width = np.sqrt(np.pi / np.maximum(determined, 0.5)) / np.log(SIZES_IN_TYPICAL[-1] / SIZES_IN_TYPICAL[0])
        return float(np.log(np.minimum(width, 1.0)).sum())

    @property
    def _expected_squares(self) -> Array:
        """Expected squares of the sizes of bands and terms."""
        of_bands = self.data.geometry.expected_squares(self.band_sizes)
        return np.asarray(np.maximum(np.append(of_bands, np.zeros(len(self.terms))), self.priors.least_share**2))

    def with_terms(self, terms: Sequence[Term]) -> Structure:
        """The structure with these terms; sizes of those that it has already stay."""
        known = {id(term): size for term, size in zip(self.terms, self.term_sizes, strict=True)}
        sizes = tuple(known.get(id(term), 1.0) for term in terms)
        return self._of_same_whitening(replace(self, terms=tuple(terms), term_sizes=sizes))

    def fitted(self) -> Structure:
        """The structure with the likeliest sizes, noise and outliers."""
        found = self.with_sizes()
        for _ in range(MOST_STRUCTURE_ROUNDS):
            before = found.noise
            found = found.with_noise().with_sizes(FURTHER_STEPS)
            if settled(before, found.noise):
                break
        return found

    def with_sizes(self, steps: int = SIZE_STEPS) -> Structure:
        """The structure with likelier sizes, after at most so many steps."""
        found, groups, counted = self, self.groups, len(self.band_sizes) + len(self.terms)
        weight = np.repeat([self.priors.band_weight, self.priors.term_weight], [len(self.band_sizes), len(self.terms)])
        fixed = np.append(self.data.geometry.fixed, np.zeros(len(self.terms), bool))
        for _ in range(steps):
            posterior, before = found.posterior, np.concatenate([found.band_sizes, found.term_sizes])
            determined = summed(groups, posterior.determined, counted)
            squares = summed(groups, posterior.mean**2, counted)
            new = np.where(fixed, before, stepped(determined, squares, found._expected_squares, weight))
            found = found.resized(new)
            if np.abs(np.log(new / before)).max(initial=0.0) < SETTLED_SIZE:
                break
        return found

    def with_noise(self) -> Structure:
        """The structure with the likeliest variances of the noise, and without outliers, unless these are many.

        Outliers are rows whose odds of an error of their own are above 1.
        """
        axes = list(self.data.observations.measurement.moving)
        factor, repeats = variances(list(self._moments(axes)), axes, self.noise, self.priors.non_repeatability_um)
        factor = max(factor, self.data.least_factor)
        left_out = outlying(self)
        if left_out.mean() >= self.priors.most_left_out:
            left_out = self.noise.left_out
        new = replace(self, noise=Noise(factor, repeats, left_out))
        if not repeats and not self.noise.repeats and np.array_equal(left_out, self.noise.left_out):
            return self._of_same_columns(new)  # a factor alone is left out of the whitening
        return new

    @cached_property
    def uncertain(self) -> list[Array]:
        """Covariances `(stops, m d, m d)` that the posterior gives the whitened rows of each stop; single precision."""
        root, white = (self.posterior.root * self.sizes).astype(np.float32).T, self.whitener
        of_terms = [white.registers(table) for table in self.columns[1:]]
        spanned = np.concatenate([self.registers, *of_terms], axis=1, dtype=np.float32)
        found = []
        for pieces in white.by_stops:
            own = []
            for piece in pieces:
                raw: Array = np.concatenate([table[piece.rows] for table in self.columns], axis=2).astype(np.float32)
                rows = piece.white(raw) - white.spanned[piece.scalars].astype(np.float32) @ spanned
                table = blas.strmm(1.0, root, rows.T, lower=0, trans_a=1, overwrite_b=1).T
                table = table.reshape(*piece.matrices.shape[:2], -1)
                own.append(table @ np.swapaxes(table, 1, 2))
            found.append(np.concatenate(own).astype(float))
        return found

    @cached_property
    def left(self) -> Array:
        """Whitened observations `(N,)` less the mean of the posterior."""
        return self.equations.residual - self.explained()

    def resized(self, sizes: Array) -> Structure:
        """The structure with other sizes of bands and terms; nothing is whitened anew."""
        bands = len(self.band_sizes)
        new = replace(self, band_sizes=sizes[:bands], term_sizes=tuple(sizes[bands:].tolist()))
        return self._of_same_columns(new)

    def _of_same_columns(self, other: Structure) -> Structure:
        """A structure of the same terms and the same whitening; nothing is whitened anew."""
        other.__dict__["equations"], other.__dict__["of_terms"] = self.equations, self.of_terms
        return self._of_same_whitening(other)

    def _of_same_whitening(self, other: Structure) -> Structure:
        """A structure whose noise has the same whitening; the geometry is not whitened anew."""
        for name in ("whitener", "registers", "of_geometry"):
            other.__dict__[name] = getattr(self, name)
        return other

    def _moments(self, axes: Sequence[str]) -> Iterator[Moments]:
        """Expected second moments of the residuals of stops without outliers, and of unit variances."""
        observations, white = self.data.observations, self.whitener
        shape = len(observations), observations.components, -1
        count = len(observations) * observations.components
        residual = self.left[:count].reshape(shape)
        for stops, matrices, uncertain in zip(self.data.stops, white.matrices, self.uncertain, strict=True):
            inside = ~self.noise.left_out[stops.rows].any(axis=1)
            own, rows = matrices[inside], stops.rows[inside]
            if not len(rows):
                continue
            left = residual[rows].reshape(*own.shape[:2], 1)
            turned = np.swapaxes(own, 1, 2)
            parts = [own @ stops.specified[inside] @ turned]
            for axis in axes:
                arm = own @ stops.arms[axis][inside][:, :, None]
                parts.append(arm @ np.swapaxes(arm, 1, 2))
            yield Moments(left * np.swapaxes(left, 1, 2) + uncertain[inside], parts)


def settled(before: Noise, after: Noise) -> bool:
    """True where two noises are the same, for all that follows."""
    changes = [
        abs(after.repeats.get(axis, 0.0) - before.repeats.get(axis, 0.0))
        / max(after.repeats.get(axis, 0.0), LEAST_REPEATABILITY_UM)
        for axis in {*before.repeats, *after.repeats}
    ]
    same_rows = np.array_equal(before.left_out, after.left_out)
    factor = abs(float(np.log(after.factor / before.factor)))
    return same_rows and factor < SAME_FACTOR and max(changes, default=0.0) < SAME_REPEATS
