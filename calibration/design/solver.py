"""One design, many right-hand sides: the fits of a whole chunk of draws by one factorisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from calibration.design.equations import Columns, Made, Sample
from calibration.design.random_machines import TrueModels
from calibration.fit.linear import NormalBlocks, Part, Posterior, of_columns, pseudo_inverse
from kinematics.transforms import Array

ZERO_EIGENVALUE = 1e-10
"""Share of the largest eigenvalue below which another counts as zero, where there is no prior."""
KEPT_DESIGNS = 4
"""Number of factorised designs in the cache."""


@dataclass(frozen=True, eq=False)
class Sizes:
    """Prior standard deviations of the parameters of a fit; infinite for a fit without priors."""

    values: Array
    """`(p,)`"""

    @property
    def known(self) -> bool:
        """False for a fit without priors."""
        return bool(np.isfinite(self.values).all())


@dataclass(frozen=True)
class Factorised:
    """Factorisation of the normal equations of one choice of bases, with its priors."""

    solve: Callable[[Array], Array]
    """Parameters `(p, draws)` of right-hand sides `(p, draws)`."""


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

    def information(self, parts: Sequence[Part]) -> Array:
        """The normal matrix `(p, p)` of a model of these parts, registration eliminated."""
        return self._blocks.matrix(parts)

    def step(self, parts: tuple[Part, ...], sizes: Sizes, left: Array, parameters: Array) -> Array:
        """The step of parameters `(p,)` for whitened residuals `(N,)`, by the same factorisation."""
        right = np.concatenate([self._of(part).observed.T @ left for part in parts])
        if sizes.known:
            right = right - parameters / sizes.values**2
        return self.factorised(parts, sizes).solve(right[:, None])[:, 0]

    def scaled(self, parts: Sequence[Part], scale: float) -> Sizes:
        """Typical sizes of the parameters, those of error motions times a scale; an infinite one for no priors."""
        return Sizes(np.concatenate([self._scaled(part, scale) for part in parts]))

    def _scaled(self, part: Part, scale: float) -> Array:
        own = self._of(part)
        return np.maximum(own.prior * scale, own.least_prior) if part[0] or np.isinf(scale) else own.prior

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

    def _factorised(self, parts: tuple[Part, ...], sizes: Sizes) -> Factorised:
        matrix = self._blocks.matrix(parts)
        if not sizes.known:
            return _least_squares(matrix)
        scale = sizes.values
        posterior, units = Posterior(matrix * np.outer(scale, scale), 1.0), scale[:, None]
        return Factorised(lambda right: posterior.solve(right * units) * units)

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
    return Factorised(lambda right: root @ (root.T @ right))
