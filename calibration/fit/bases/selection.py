"""Choice of the bases of the error motions by the evidence, the probability of the data.

Too coarse a basis leaves a misfit that no number of points averages out; the determinant in the evidence penalises too
fine a basis. The search is that of `calibration.fit.bases.search`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np

from calibration.cores import each
from calibration.fit.bases.search import (
    MOST_LINEAR_PARAMETERS,
    ROTARY_KIND,
    SIZES,
    Choice,
    Search,
    Unexplained,
    chosen,
    scale_of,
)
from calibration.fit.fit import DOUBTFUL_P, Fit, fit
from calibration.fit.linear import NormalBlocks, Part
from calibration.fit.problem import solution
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import (
    BasisChoice,
    axis_effects,
    least_priors,
    parse_basis,
    priors,
    with_effects,
)
from calibration.observation.normal_equations import NormalEquations, decorrelation_of, residuals, whitened
from calibration.observation.outliers import Variance
from calibration.observation.products import Products, arm_products, between, factored
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress, silent
from kinematics.transforms import Array, read_only

MOST_FIRST_NODES = 24
"""Largest number of nodes of an axis in the first fit."""
MOST_EVIDENCE_ROWS = 5000
"""Largest number of rows, evenly spread, in the evidence."""
COARSE_PARAMETERS, COARSE_TURN_PARAMETERS = 3, 5
"""Largest numbers of parameters of linear and rotary axes in the coarse fit."""
REGISTRATION: Part = ("", "registration")
OTHER_EFFECTS: Part = ("", "besides")


def choose(
    measurement: Measurement,
    kinds: Sequence[str],
    *,
    rotary_kind: str | None = None,
    effects: Sequence[Effect] = (),
    prior_scale: float | None = None,
    finest: int = MOST_LINEAR_PARAMETERS,
    unexplained: Unexplained | None = None,
    progress: Progress = silent,
) -> Choice:
    """The choice of `calibration.fit.bases.search.chosen` for a measurement.

    rotary_kind: kind of basis for rotary axes. effects: fitted in addition. A given prior_scale is not changed. A first
    fit finds outliers, registration and, where the specified uncertainties are too small (p < DOUBT), the size of the
    noise. Spheres are few rows, with which fine bases reach a row that is off: it is found by a coarse fit.
    """
    if measurement.instrument.OBSERVES == "offset":
        measurement = measurement.rows(np.flatnonzero(coarse_fit(measurement, effects).kept))
    search = Search.of(measurement, kinds, rotary_kind, prior_scale, finest)
    fine = {
        axis: BasisChoice("b-spline", max(2, min(MOST_FIRST_NODES, number))) for axis, number in search.most.items()
    }
    # few readings do not show the size of their noise
    variance: Variance = "sheet" if measurement.instrument.MAY_BE_FEW else "estimate"
    evidence = LinearEvidence(fitted(measurement, Choice(fine, 1.0), effects, variance, typical=True), effects)
    return chosen(search, 1, lambda choices, _: evidence.of_all(choices), unexplained, progress)[0]


def coarse_fit(measurement: Measurement, effects: Sequence[Effect] = ()) -> Fit:
    """A fit of coarse bases, which cannot imitate single rows, with the noise of its residuals."""
    return fitted(measurement, coarse_choice(measurement, effects), effects)


def coarse_choice(measurement: Measurement, effects: Sequence[Effect] = (), prior_scale: float | None = None) -> Choice:
    """The choice among coarse bases: parabolas of linear axes and two harmonics of rotary axes at most."""
    search = Search.of(measurement, ("legendre",), ROTARY_KIND, prior_scale, COARSE_PARAMETERS, COARSE_TURN_PARAMETERS)
    evidence = LinearEvidence(fitted(measurement, search.start("legendre"), effects), effects)
    return chosen(search, 1, lambda choices, _: evidence.of_all(choices))[0]


def fitted(
    measurement: Measurement,
    choice: Choice,
    effects: Sequence[Effect],
    variance: Variance = "estimate",
    near: Fit | None = None,
    progress: Progress = silent,
    *,
    typical: bool = False,
) -> Fit:
    """The fit of the bases of a choice and additional effects, with their priors; the rest as in `fit`.

    typical: the priors are the typical sizes, also where the instrument needs larger ones (`least_priors`).
    """
    model, prior = with_effects(measurement, choice.bases, effects, *choice.scales)
    if typical:
        prior = priors(model)
    return fit(measurement, model, prior=prior, variance=variance, near=near, progress=progress)


def finer(choice: Choice, measurement: Measurement, margin: int) -> Choice:
    """The choice with the bases of all axes finer by `margin` sizes, as far as the number of positions permits.

    The evidence tolerates a misfit of the order of u, which u does not include. Where data are dense, the additional
    uncertainty of a finer basis is smaller than this misfit.
    """
    bases = dict(choice.bases)
    for axis, basis in choice.bases.items():
        most = min(measurement.distinct_positions[axis], MOST_LINEAR_PARAMETERS if axis[0] not in "ABC" else np.inf)
        sizes = [size for size in SIZES[basis.kind] if size > basis.size]
        few = [BasisChoice(basis.kind, s) for s in sizes if BasisChoice(basis.kind, s).over((0.0, 1.0)).size <= most]
        bases[axis] = few[:margin][-1] if few[:margin] else basis
    return replace(choice, bases=bases)


class LinearEvidence:
    """Log marginal likelihood of choices, up to a constant of the data, to first order about a first fit.

    The normal equations of a choice are assembled from blocks, one for each pair of its parts (registration, each axis
    in its basis, additional effects). Each block is computed once, however many choices share it.
    """

    def __init__(self, first: Fit, effects: Sequence[Effect]) -> None:
        rows = np.flatnonzero(first.kept)
        some = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_EVIDENCE_ROWS)).astype(int)]
        self._measurement, self._registration = first.measurement.rows(some), first.registration
        self._factor = first.variance_factor if first.p_value < DOUBTFUL_P else 1.0
        self._effects = tuple(effects)
        # the additional effects start at their values of the first fit
        other_effects = sum(len(effect.parameters) for effect in effects)
        self._other_effects = first.model.parameters[len(first.prior) - other_effects :]
        self._white = self._measurement.whiteners / np.sqrt(self._factor)
        self._transform = self._white @ self._measurement.instrument.transform(self._measurement, self._registration)
        at_start = msgspec.structs.replace(self._measurement.nominal_model, effects=self._effects)
        left = residuals(self._measurement, at_start.with_parameters(self._other_effects), self._registration)
        self._decorrelation = decorrelation_of(self._measurement)
        self._residual = self._decorrelation.apply(whitened(self._white, left))
        self._columns = cache(self._made)
        self._arms: dict[str, Array] = {}
        self._arm_products: dict[tuple[str, str], Array] = {}
        self._right = cache(self._along)
        self._priors = cache(self._typical)
        self._least = cache(self._smallest)
        own = self._priors(OTHER_EFFECTS)
        start = np.array([value for effect in effects for value in effect.parameters])
        self._moved = np.where(np.isfinite(own), (self._other_effects - start) / own, 0.0)
        self._blocks = NormalBlocks(self._between)
        self._known: dict[str, float] = {}

    def of_all(self, choices: Sequence[Choice]) -> Array:
        """The evidence `(choices, 1)` of choices."""
        return np.array(each(self._of, choices))[:, None]

    def _of(self, choice: Choice) -> float:
        key = repr(choice)
        if key not in self._known:
            self._known[key] = self._evidence(choice)
        return self._known[key]

    def _evidence(self, choice: Choice) -> float:
        axes: list[Part] = [(axis, str(basis)) for axis, basis in choice.bases.items()]
        parts = [REGISTRATION, *axes, OTHER_EFFECTS]
        normal = NormalEquations(self._blocks.matrix(parts), np.concatenate([self._right(part) for part in parts]))
        normal.add_stated(self._measurement, self._registration)
        prior = np.concatenate(
            [*(self._scaled(part, scale_of(choice.scales, part[0])) for part in axes), self._priors(OTHER_EFFECTS)]
        )
        away = np.zeros(len(prior))
        away[len(prior) - len(self._moved) :] = self._moved
        solved = solution(normal, self._registration, prior, away)
        return -0.5 * (float(np.sum(self._residual**2)) - solved.reduction + solved.log_determinant)

    def _along(self, part: Part) -> Array:
        """J'r `(parameters,)`: products of the columns of a part with the residual."""
        return read_only(self._columns(part).along(self._residual))

    def _between(self, a: Part, b: Part) -> Array:
        """Ja'Jb of two parts."""
        first, second, axes = self._columns(a), self._columns(b), (a[0], b[0])
        if first.functions is None or second.functions is None:
            return between(first, second)
        if axes not in self._arm_products:
            self._arm_products[axes] = arm_products(first, second)
        return between(first, second, self._arm_products[axes])

    def _scaled(self, part: Part, scale: float) -> Array:
        """Priors `(parameters,)` of the error motions of an axis, as in the fit."""
        return np.maximum(scale * self._priors(part), self._least(part))

    def _smallest(self, part: Part) -> Array:
        return least_priors(self._measurement, self._model(part))

    def _typical(self, part: Part) -> Array:
        """Priors `(parameters,)` of a part."""
        return priors(self._model(part))

    def _made(self, part: Part) -> Products:
        """Whitened derivatives by the parameters of a part."""
        if part == REGISTRATION:
            design = self._measurement.instrument.registration_design(self._measurement, self._registration)
            return Products(self._white @ design).decorrelated(self._decorrelation)
        machine, state = self._measurement.machine, self._measurement.state
        made = factored(self._model(part), machine, state, self._transform).decorrelated(self._decorrelation)
        # the arms of an axis are the same in all bases
        return made if made.functions is None else replace(made, arms=self._arms.setdefault(part[0], made.arms))

    def _model(self, part: Part) -> ErrorModel:
        """The model of a part: the error motions of an axis in its basis, or the additional effects."""
        axis, basis = part
        own = self._effects if part == OTHER_EFFECTS else axis_effects(self._measurement, axis, parse_basis(basis))
        model = msgspec.structs.replace(self._measurement.nominal_model, effects=tuple(own))
        return model.with_parameters(self._other_effects) if part == OTHER_EFFECTS else model
