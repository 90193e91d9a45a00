"""The sizes of the error motions of every draw, as `ncomp fit` finds them for automatic bases."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.design.equations import OTHER_EFFECTS, Columns, Sample
from calibration.design.solver import Fits, Sizes
from calibration.fit.linear import Part
from calibration.gaussian_terms.band_sizes import likeliest
from calibration.gaussian_terms.geometry import Asked, Bands, automatic_bases, bands_of
from calibration.gaussian_terms.posterior import Equations
from calibration.observation.full_model import BasisChoice, least_priors
from kinematics.transforms import Array


def automatic_parts(columns: Columns) -> tuple[Part, ...]:
    """The parts of a model whose sizes the data decide."""
    return with_other_effects(columns, automatic_bases(columns.measurement, of_fit=True))


def stated_sizes(fits: Fits, parts: tuple[Part, ...], scale: float) -> Sizes:
    """Sizes of automatic bases where the size of the errors is stated: in typical sizes."""
    return Sizes(_bands(fits, parts, Asked(scale=scale, of_fit=True))[1])


def chosen(fits: Fits, parts: tuple[Part, ...], drawn: Sample) -> dict[tuple[tuple[Part, ...], Sizes], np.ndarray]:
    """Number `(1,)` of each draw by the parts of its fit and their likeliest sizes."""
    known = fits.columns.measurement.machine.priors
    bands, prior = _bands(fits, parts, Asked(of_fit=True))
    information = fits.information(parts) * np.outer(prior, prior)
    along = np.concatenate([fits.right(part, drawn) for part in parts]) * prior[:, None]

    def sizes(right: Array) -> Sizes:
        found = likeliest(Equations(np.zeros(0), information, right), bands, known, 1.0, bands.first_sizes)
        return Sizes(prior * found.sizes[bands.bands])

    return {(parts, sizes(right)): np.array([draw]) for draw, right in enumerate(along.T)}


def _bands(fits: Fits, parts: tuple[Part, ...], asked: Asked) -> tuple[Bands, Array]:
    """The bands of the parameters, and their prior sizes `(p,)`."""
    model, measurement = fits.columns.model(parts), fits.columns.measurement
    return bands_of(model, asked, measurement.machine.priors, least_priors(measurement, model))


def with_other_effects(columns: Columns, bases: Mapping[str, BasisChoice]) -> tuple[Part, ...]:
    """The parts of a model with these bases, and of its additional effects."""
    other_effects = ((OTHER_EFFECTS, ""),) if columns.other_effects else ()
    return (*((axis, str(basis)) for axis, basis in bases.items()), *other_effects)
