"""A fit, linearised at its solution: candidates are evaluated on it without a new fit.

With J the whitened design of registration and model, in units of its priors, H = J'J + priors, and r the whitened
residual, a candidate's columns G explain, jointly with everything in J, b' S^-1 b of the sum of squares, where
b = G'r and S = G'G - G'J H^-1 J'G, the Schur complement: the part of G that neither the model nor the registration
can imitate.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from calibration.cores import each
from calibration.diagnosis.search.derivatives import Signals, derivatives, together, widths
from calibration.diagnosis.search.evaluated_rows import evaluated_rows
from calibration.diagnosis.search.held_out import HeldBlock, HeldOut, HeldResiduals
from calibration.diagnosis.search.score import Complement, Projected, Rating, Score
from calibration.fit.fit import Fit
from calibration.fit.linear import Posterior
from calibration.measurement.estimated_noise import Decorrelation
from calibration.measurement.measurement import Measurement
from calibration.observation.correlation import correlation_length, lines_of
from calibration.observation.normal_equations import decorrelation_of, whitened, whiteners
from calibration.observation.outliers import huber_weights, robust_factor
from calibration.observation.stops_and_lines import held_out_blocks, lines_or_positions, whole_stops
from kinematics.effects import Effect
from kinematics.state import State
from kinematics.transforms import Array

Made = TypeVar("Made")
SHARED = "_shared"
"""Results of `once` of the fits of `draws`, by their names."""
RIDGE = 1e-9
"""Ridge on the diagonal of H; columns of the registration have unit length."""
OF_THE_DESIGN = (
    *("information", "posterior", "spanned", "degrees_of_freedom", "state", "units", "spread", "held_out", "_gram"),
    SHARED,
)
"""Cached properties that do not depend on the residual."""
OF_THE_ROWS = ("state", "units", "spread", "held_out")
"""Cached properties that depend on the rows alone."""
BARELY = 5.0
"""Gain up to which no candidate is named, however the residuals are correlated."""


@dataclass(frozen=True)
class LinearisedFit:
    """Rows of a measurement, the whitened design of the fitted parameters, and the residual."""

    fit: Fit
    rows: np.ndarray
    """Rows of the measurement `(n,)` on which candidates are evaluated."""
    white: Array
    """Whiteners `(n, d, d)` with weights: the square of an outlying row is bounded."""
    decorrelation: Decorrelation
    """Transform of the whitened rows of each stop."""
    transform: Array
    """Whitened derivatives `(n, d, width)` by the error motions and the shift of the observed point; rows of a stop not
    decorrelated."""
    design: Array
    """J `(N, q)`: registration, then parameters in units of their priors; white."""
    limited: Array
    """Diagonal `(q,)` of the priors' part of H."""
    residual: Array
    """r `(N,)`"""
    away: Array
    """Distances `(q,)` of the parameters from their start, in units of their priors; 0 of the registration."""
    good: np.ndarray
    """True `(n,)` for rows that the fit kept."""
    weights: Array
    """Weights `(n,)` of the rows."""

    @classmethod
    def of(cls, fit: Fit) -> LinearisedFit:
        """The fit, linearised at its solution."""
        measurement = fit.measurement
        rows = evaluated_rows(fit)
        some = measurement.rows(rows)
        white = whiteners(some)
        components = some.components
        distances = np.sum(whitened(white, fit.residual[rows]) ** 2, axis=1)
        effective_parameters = fit.effective_parameters * len(rows) / max(int(np.count_nonzero(fit.kept)), 1)
        weights = huber_weights(
            distances,
            components,
            robust_factor(distances, components, effective_parameters, fit.variance_factor, measurement.stops[rows]),
        )
        # the square of an outlier is bounded, so that no cause is found in a few of them
        weights = np.where(fit.kept[rows], weights, weights**2)
        decorrelation = decorrelation_of(some, weights)
        white = white * np.sqrt(weights / fit.variance_factor)[:, None, None]
        parts = derivatives(fit, measurement, rows, fit.registration, white, decorrelation)
        length = np.linalg.norm(parts.own, axis=0)
        own = parts.own / np.where(length > 0, length, 1.0)
        limits = np.isfinite(fit.prior).astype(float) if fit.prior.ndim == 1 else np.ones(parts.by_model.shape[1])
        limited = np.concatenate([np.full(own.shape[1], RIDGE), limits + RIDGE])
        residual = decorrelation.apply(whitened(white, fit.residual[rows])).reshape(-1)
        design, away = np.concatenate([own, parts.by_model], axis=1), np.concatenate([np.zeros(own.shape[1]), fit.away])
        kept = fit.kept[rows]
        blank = cls(fit, rows, white, decorrelation, parts.transform, design, limited, residual, away, kept, weights)
        return blank._at_rest()

    def without(self, *effects: int) -> LinearisedFit:
        """The linearised fit of the model without some of its effects, given by number."""
        model = self.fit.model
        own = np.concatenate([np.arange(model.slices[effect].start, model.slices[effect].stop) for effect in effects])
        columns = own + self.design.shape[1] - len(model.parameters)
        linear = [quantity.linear for effect in effects for quantity in model.effects[effect].parameter_table]
        scale = (self.fit.prior if self.fit.prior.ndim == 1 else np.diag(self.fit.prior))[own]
        values = model.parameters[own] * linear / np.where(np.isfinite(scale), scale, 1.0)
        fewer = replace(
            self,
            design=np.delete(self.design, columns, axis=1),
            limited=np.delete(self.limited, columns),
            away=np.delete(self.away, columns),
            residual=self.residual + self.design[:, columns] @ values,
        )
        kept = np.setdiff1d(np.arange(self.design.shape[1]), columns)
        return fewer._of_same_rows(self, self.information[np.ix_(kept, kept)])._at_rest()

    def along(self, effect: Effect, prior: Array) -> LinearisedFit:
        """The linearised fit of the model with one effect more, linear and at zero, with priors `(k,)`."""
        typical = np.array([quantity.typical for quantity in effect.parameter_table])
        finite = np.isfinite(prior)
        in_priors = np.where(finite, prior, 1.0) / np.where(np.isfinite(typical), typical, 1.0)
        return self.beside(self.columns(effect) * in_priors, finite)

    def beside(self, columns: Array, limited: Array | bool = True) -> LinearisedFit:
        """The linearised fit with white columns `(N, k)` more, in units of their priors where these are `limited`."""
        k = columns.shape[1]
        more = replace(
            self,
            design=np.concatenate([self.design, columns], axis=1),
            limited=np.concatenate([self.limited, np.broadcast_to(limited, k) + RIDGE]),
            away=np.concatenate([self.away, np.zeros(k)]),
        )
        shared = (columns.T @ self.design).T
        information = np.block([[self.information, shared], [shared.T, columns.T @ columns]])
        return more._of_same_rows(self, information)._at_rest()

    def _of_same_rows(self, other: LinearisedFit, information: Array) -> LinearisedFit:
        """This linearised fit with its `information`, and with the results that depend on the rows of another alone."""
        vars(self).update({name: vars(other)[name] for name in OF_THE_ROWS if name in vars(other)})
        vars(self)["information"] = information
        return self

    def _at_rest(self) -> LinearisedFit:
        """The linearised fit at the minimum of its own objective."""
        step = self.posterior.solve(self.design.T @ self.residual - self.limited * self.away)
        return self._with_residual(self.residual - self.design @ step, self.away + step)

    def _with_residual(self, residual: Array, away: Array) -> LinearisedFit:
        """The same rows and design with another residual; results that depend on these alone are kept."""
        other = replace(self, residual=residual, away=away)
        vars(other).update({name: vars(self)[name] for name in OF_THE_DESIGN if name in vars(self)})
        return other

    def less(self, values: Array) -> LinearisedFit:
        """The linearised fit of observations less values `(n, d)`, mm and rad, of all rows of the measurement."""
        white = self.decorrelation.apply(whitened(self.white, values[self.rows])).reshape(-1)
        return self._with_residual(self.residual - white, self.away)._at_rest()

    def thinned(self, most: int) -> LinearisedFit:
        """The linearised fit of at most so many of its rows: whole stops, evenly spread."""
        if len(self.rows) <= most:
            return self
        return self.of_rows(whole_stops(self.measurement.stops[self.rows], most))

    def of_rows(self, kept: np.ndarray) -> LinearisedFit:
        """The linearised fit of some of its rows, given by their indices `(k,)` in order."""
        n = len(self.rows)
        some = self.measurement.rows(self.rows[kept])
        mine = (kept[:, None] * (self.scalars // n) + np.arange(self.scalars // n)).reshape(-1)
        fewer = replace(
            self,
            rows=self.rows[kept],
            white=self.white[kept],
            decorrelation=decorrelation_of(some, self.weights[kept]),
            transform=self.transform[kept],
            design=self.design[mine],
            residual=self.residual[mine],
            good=self.good[kept],
            weights=self.weights[kept],
        )
        if 2 * len(kept) > n:
            lost = np.delete(self.design, mine, axis=0)
            vars(fewer)["information"] = self.information - lost.T @ lost
        return fewer._at_rest()

    @cached_property
    def units(self) -> np.ndarray:
        """Numbers `(n,)` of the units of its rows that keep their structure in surrogates, as `lines_or_positions`."""
        return lines_or_positions(self.measurement.rows(self.rows))

    def once(self, name: Hashable, made: Callable[[], Made]) -> Made:
        """A result that does not depend on the residual: of `draws` made once for all of them."""
        known: dict[Hashable, Any] | None = vars(self).get(SHARED)
        if known is None:
            return made()
        if name not in known:
            known[name] = made()
        found: Made = known[name]
        return found

    def draws(self, rng: np.random.Generator, count: int) -> Iterator[LinearisedFit]:
        """So many of `shuffled`, which share what does not depend on the residual."""
        common = self._with_residual(self.residual, self.away)
        vars(common)[SHARED] = {}
        for _ in range(count):
            yield common.shuffled(rng)

    def shuffled(self, rng: np.random.Generator) -> LinearisedFit:
        """The linearised fit of residuals of the same size, the sign of each unit of rows drawn at random."""
        signs = rng.choice([-1.0, 1.0], int(self.units.max()) + 1)[self.units]
        signs = np.repeat(signs, self.scalars // len(self.rows))
        return self._with_residual(self.residual * signs, self.away)._at_rest()

    @property
    def evenly_noisy(self) -> LinearisedFit:
        """The same fit with the specified noise, enlarged in all directions to the size of the residuals.

        Estimated non-repeatability of an axis holds a dependence that acts along that axis.
        """
        fit = self.fit
        if fit.measurement.noise is None:
            return self
        specified = replace(fit.measurement, noise=None)
        return LinearisedFit.of(replace(fit, measurement=specified, variance_factor=max(fit.chi2_reduced, 1.0)))

    @property
    def measurement(self) -> Measurement:
        """The measurement of the fit, all rows."""
        return self.fit.measurement

    @property
    def scalars(self) -> int:
        """Number N of scalar residuals."""
        return len(self.residual)

    @cached_property
    def squares(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)

    @cached_property
    def spread(self) -> float:
        """Log determinant of the covariance of the noise of its rows, twice the log of its volume."""
        white = whiteners(self.measurement.rows(self.rows)) / np.sqrt(self.fit.variance_factor)
        decorrelation = Decorrelation.of(
            self.measurement.rows(self.rows).noise, white * np.sqrt(self.fit.variance_factor)
        )
        return -2.0 * (float(np.linalg.slogdet(white)[1].sum()) + decorrelation.log_determinant)

    @cached_property
    def information(self) -> Array:
        """J'J `(q, q)`."""
        return np.asarray(self.design.T @ self.design)

    @cached_property
    def posterior(self) -> Posterior:
        """H, factorised."""
        return Posterior(self.information, self.limited)

    @cached_property
    def spanned(self) -> Array:
        """J L'^-1 `(N, q)`, with L L' = H: columns along which the model and the registration absorb signals."""
        return self.posterior.spanned(self.design)

    @property
    def has_spanned(self) -> bool:
        """True where `spanned` is known already."""
        return "spanned" in vars(self)

    @cached_property
    def degrees_of_freedom(self) -> float:
        """N less the effective parameters of the model and the registration."""
        return max(self.scalars - self.posterior.effective_parameters, 1.0)

    @cached_property
    def state(self) -> State:
        """State of its rows alone; effects with a memory need the rows between them as well."""
        return self.measurement.state.rows(self.rows)

    def positions(self, axis: str) -> Array:
        """Positions `(n,)` of an axis, mm or degrees."""
        return self.state.position(self.measurement.machine, axis)

    @property
    def _effects(self) -> Signals:
        return Signals(self.measurement, self.rows, self.transform, self.decorrelation)

    def columns(self, *effects: Effect) -> Array:
        """Whitened derivatives `(N, k)` by the linear parameters of effects, in units of their typical sizes."""
        return self._effects.of(effects)

    def candidate(self, effect: Effect, unit: float | Array = 1.0) -> Projected:
        """Part of an effect that the model and the registration cannot imitate, its columns in `unit` typical sizes.

        Only changes with time and temperature count: the model holds the signal at their means, which is subtracted.
        """
        return self.projected(self._effects.changing((effect,)) * unit)

    def candidates(self, effects: Sequence[Effect], done: Callable[[float], None] = lambda _: None) -> list[Projected]:
        """`candidate` of each effect, its columns in typical sizes; done: called with the share of those found."""
        some = each(lambda some: self._apart(some, self._effects.changing(some)), together(effects), done)
        return list(chain.from_iterable(some))

    def responses(self, effects: Sequence[Effect]) -> list[Projected]:
        """Part of each effect's columns, means included, that the model and the registration cannot imitate."""
        return [one for some in together(effects) for one in self._apart(some, self._effects.of(some))]

    def projected(self, columns: Array) -> Projected:
        """Columns `(N, k)` and their part that the model and the registration cannot imitate."""
        through = self._through(columns)
        return Projected(columns, through, columns.T @ columns - through.T @ through)

    def _through(self, columns: Array) -> Array:
        """L^-1 J'G `(q, k)` of columns G `(N, k)`; see `Projected.through`."""
        # in this order BLAS takes half the time for narrow columns
        return self.posterior.whitened((columns.T @ self.design).T)

    def _apart(self, effects: Sequence[Effect], columns: Array) -> list[Projected]:
        """`Projected` of each effect, from the columns `(N, k)` of all effects side by side."""
        through, found, end = self._through(columns), [], 0
        for width in widths(effects):
            own = slice(end, end := end + width)
            schur = columns[:, own].T @ columns[:, own] - through[:, own].T @ through[:, own]
            found.append(Projected(columns[:, own], through[:, own], schur))
        return found

    def score(self, candidate: Projected, shapes: int = 0, trials: float = 1.0) -> Score:
        """Score of a candidate; `shapes` of its parameters were searched for, in `trials` trials.

        Only the reduction of the data's squares counts: a candidate that merely relieves the priors of the model, whose
        signal it shares, explains nothing. Residuals that are correlated in the direction of its signal count once, as
        far as they are correlated both without it and with it.
        """
        complement, along = Complement.of(candidate.schur), candidate.columns.T @ self.residual
        score = self.rated(complement, along, candidate.through, shapes, trials)
        if not score.gain > BARELY or self._correlation_length == 1.0:
            return score
        signal = candidate.columns @ score.size - self.design @ (self.posterior.root @ (candidate.through @ score.size))
        lines = lines_of(signal.reshape(len(self.rows), -1))
        course = (np.sum(each.reshape(lines.shape) * lines, axis=1) for each in (self.residual, self.residual - signal))
        correlated = min(correlation_length(each[:, None]) for each in course)
        return self._rating.scored(score.squares, score.effective_parameters, trials, score.size, correlated)

    def rated(
        self, complement: Complement, along: Array, through: Array, shapes: int = 0, trials: float = 1.0
    ) -> Score:
        """The same from the Schur complement of columns and the residual `along` them `(k,)`, as `Rating.of`.

        Rows count as independent.
        """
        return self._rating.of(complement, along, through, shapes, trials)

    @cached_property
    def _rating(self) -> Rating:
        return Rating(self.squares, self.scalars, self.degrees_of_freedom, self._through(self.residual), self._gram)

    @cached_property
    def _gram(self) -> Array:
        """S'S `(q, q)` of the spanned columns: R'J'J R with R'H R = 1."""
        root = self.posterior.root
        return np.asarray(np.eye(len(root)) - root.T @ (self.limited[:, None] * root))

    @cached_property
    def _correlation_length(self) -> float:
        return correlation_length(self.residual.reshape(len(self.rows), -1))

    @cached_property
    def held_out(self) -> tuple[np.ndarray, str]:
        """Labels of the blocks of all rows of the measurement, and the name of the blocks."""
        return held_out_blocks(self.measurement)

    def held_by(self, labels: np.ndarray, name: str) -> LinearisedFit:
        """The same linearised fit with other blocks, by their labels `(n,)` of all rows; name: as of `held_out`."""
        other = replace(self)
        vars(other).update({each: vars(self)[each] for each in OF_THE_DESIGN if each in vars(self)})
        vars(other)["held_out"] = labels, name
        return other

    @cached_property
    def _by_others(self) -> HeldOut:
        """Its rows in the blocks of `held_out`."""
        return self.once("held out", self._held_out_rows).with_residual(self.residual)

    def _held_out_rows(self) -> HeldOut:
        runs = len(self.fit.registration.names) if self.measurement.axis is not None else 0
        some, labels = self.measurement.rows(self.rows), self.held_out[0][self.rows]
        return HeldOut(some, labels, self.design, self.residual, self.information, self.limited, runs)

    @property
    def blocks(self) -> list[HeldBlock]:
        """The blocks of `held_out`, each predicted by a fit of all the others."""
        return self._by_others.blocks

    def held_out_gains(self, candidate: Projected) -> Array:
        """Reduction of the squares of each block's counted residuals by the candidate in the fit of the other blocks.

        Only of blocks on which it acts, if these are several: a knock at the end acts on the last blocks alone.
        Outliers count with their weights: a cause that the model lacks makes outliers.
        """
        size, count = self._size_of(candidate), len(self.blocks)
        return self._by_others.gains([candidate] * count, [size] * count, range(count))

    def gains_of_each(self, candidates: Sequence[Projected], numbers: Sequence[int]) -> Array:
        """The same of some blocks, given by number, with a candidate for each."""
        return self._by_others.gains(candidates, [self._size_of(one) for one in candidates], numbers)

    def _size_of(self, candidate: Projected) -> Array:
        """Its linear parameters `(k,)` in the fit of all rows."""
        along = candidate.columns.T @ self.residual
        return self.rated(Complement.of(candidate.schur), along, candidate.through).size

    def in_lengths(self, residual: Array) -> Array:
        """A white residual `(N,)` as lengths `(n, d)`, mm and rad."""
        correlated = self.decorrelation.undone(residual.reshape(len(self.rows), -1))
        return np.asarray(np.linalg.solve(self.white, correlated[:, :, None])[:, :, 0])

    @cached_property
    def cross_validation(self) -> HeldResiduals:
        """Residuals of every block under a fit of all the others, to first order."""
        held_residual, counted = self._by_others.held_residual
        in_mm = self.in_lengths(held_residual) * self.measurement.per_micro[self.rows]
        counted = counted.reshape(len(self.rows), -1)[:, 0] & self.good
        return HeldResiduals(in_mm, counted, len(self.blocks), self.held_out[1])
