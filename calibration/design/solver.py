"""One design, many right-hand sides: the fits of a whole chunk of draws by one factorisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from calibration.design.equations import Columns, Made, Sample
from calibration.design.random_machines import TrueModels
from calibration.fit.bases.search import Scales, scale_of
from calibration.fit.linear import NormalBlocks, Part, Posterior, of_columns, pseudo_inverse
from kinematics.transforms import Array

ZERO_EIGENVALUE = 1e-10
"""Share of the largest eigenvalue below which another counts as zero, where there is no prior."""
KEPT_DESIGNS = 160
"""Number of factorised designs in the cache."""


@dataclass(frozen=True)
class Factorised:
    """Factorisation of the normal equations of one choice of bases, with its priors."""

    solve: Callable[[Array], Array]
    """Parameters `(p, draws)` of right-hand sides `(p, draws)`."""
    log_determinant: float
    """Log determinant of the matrix in units of the priors; nan without priors."""


@dataclass
class Fits:
    """Fits of one case for any choice of bases: blocks are computed once, however many choices share them."""

    columns: Columns
    true_models: TrueModels
    _made: dict[Part, Made] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.true_observed, self.true_volume = self.columns.of_true_models(self.true_models)
        self._blocks = NormalBlocks(of_columns(lambda part: self._of(part).observed))
        self.factorised = lru_cache(maxsize=KEPT_DESIGNS)(self._factorised)

    def right(self, part: Part, drawn: Sample) -> Array:
        """The right-hand sides `(k, draws)` of a part, in units of its parameters."""
        return self._of(part).observed.T @ drawn.observed

    def step(self, parts: tuple[Part, ...], scales: Scales, left: Array, parameters: Array) -> Array:
        """The step of parameters `(p,)` for whitened residuals `(N,)`, by the same factorisation."""
        right = np.concatenate([self._of(part).observed.T @ left for part in parts])
        if np.isfinite(scales[0]):
            right = right - parameters / self.scale(parts, scales) ** 2
        return self.factorised(parts, scales).solve(right[:, None])[:, 0]

    def scale(self, parts: Sequence[Part], scales: Scales) -> Array:
        """Prior standard deviations `(p,)`: typical sizes, for error motions times their `scales`."""
        return np.concatenate([self._scaled(part, scales) for part in parts])

    def _scaled(self, part: Part, scales: Scales) -> Array:
        own, axis = self._of(part), part[0]
        if not axis or not np.isfinite(scales[0]):
            return own.prior
        return np.maximum(own.prior * scale_of(scales, axis), own.least_prior)

    def errors(self, parts: Sequence[Part], parameters: Array, coefficients: Array) -> Array:
        """RMS error `(volumes, draws)`, um, of true models `(t, draws)` after correction by fits `(p, draws)`."""
        left = self.true_volume @ coefficients
        left -= np.concatenate([self._of(part).volume for part in parts], axis=1) @ parameters
        return self._rms(left)

    def before(self, coefficients: Array) -> Array:
        """RMS error `(volumes, draws)`, um, of true models `(t, draws)` without a correction."""
        return self._rms(self.true_volume @ coefficients)

    def _rms(self, deviations: Array) -> Array:
        ends = np.cumsum([len(volume.state) * 3 for volume in self.columns.volumes])[:-1]
        return np.stack([rms(part) for part in np.split(deviations, ends)])

    def _factorised(self, parts: tuple[Part, ...], scales: Scales) -> Factorised:
        matrix = self._blocks.matrix(parts)
        if np.isinf(scales[0]):
            return _least_squares(matrix)
        scale = self.scale(parts, scales)
        posterior, units = Posterior(matrix * np.outer(scale, scale), 1.0), scale[:, None]
        return Factorised(lambda right: posterior.solve(right * units) * units, posterior.log_determinant)

    def _of(self, part: Part) -> Made:
        if part not in self._made:
            self._made[part] = self.columns.of_part(part)
        return self._made[part]


def rms(deviations: Array) -> Array:
    """RMS length `(draws,)` of deviations `(3 n, draws)`."""
    return np.asarray(np.sqrt(np.sum(deviations**2, axis=0) / (len(deviations) / 3)))


def _least_squares(matrix: Array) -> Factorised:
    """The fit without priors, by the pseudo-inverse: directions that the data do not determine stay zero."""
    size = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    root = pseudo_inverse(matrix / np.outer(size, size), ZERO_EIGENVALUE).root / size[:, None]
    return Factorised(lambda right: root @ (root.T @ right), float("nan"))
