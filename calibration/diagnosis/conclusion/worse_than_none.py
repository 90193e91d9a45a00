"""The calibration that was given as it is, compared with the machine without a correction."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calibration.diagnosis.conclusion.guard import BLOCKS, blocks_of, in_units, rms_um
from calibration.fit.cross_validation import Gains
from calibration.gaussian_terms.noise import stops_of
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Structure
from calibration.gaussian_terms.whitened import Whitener
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array


class AsGiven(NamedTuple):
    """RMS residuals, um per scalar, of the rows that are not left out; the registration is that of these rows."""

    rms_um: float
    """With the calibration."""
    none_rms_um: float
    """Without a correction."""
    worse: bool
    """True where the calibration is worse beyond the spread of the blocks."""


def as_given(structure: Structure) -> AsGiven | None:
    """The calibration as it was given, on the rows of a structure; None without one."""
    given = structure.data.observations.given
    if given is None:
        return None
    own, none = _residual(structure, given), _residual(structure, None)
    gains = Gains(_by_block(structure, none) - _by_block(structure, own), _white(structure, none, own))
    return AsGiven(rms_um(structure, own), rms_um(structure, none), gains.worse)


def _residual(structure: Structure, given: ErrorModel | None) -> Array:
    """Whitened residuals `(N,)` of a calibration alone, or of the nominal machine."""
    data = structure.data.observations
    observations = replace(Observations.of(data.measurement, given=given), specified=data.specified)
    return Whitener.of(observations, stops_of(observations), structure.noise).residual()


def _by_block(structure: Structure, residual: Array) -> Array:
    """Sums of squares `(blocks,)`, um2, of whitened residuals."""
    measurement = structure.data.observations.measurement
    squares = np.sum((in_units(structure, residual) * measurement.per_micro) ** 2, axis=1)
    labels = blocks_of(structure)[: len(squares) * structure.data.observations.components]
    own = labels[:: structure.data.observations.components]
    return np.asarray(np.bincount(own, squares, minlength=BLOCKS), float)


def _white(structure: Structure, none: Array, own: Array) -> Array:
    """Differences of sums of squares `(blocks,)` in variances of the noise; stated values are in no block."""
    labels = blocks_of(structure)
    inside = labels >= 0
    return np.asarray(np.bincount(labels[inside], (none**2 - own**2)[inside], minlength=BLOCKS), float)
