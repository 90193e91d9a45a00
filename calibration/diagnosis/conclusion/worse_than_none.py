"""The calibration that was given as it is, compared with the machine without a correction."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from calibration.diagnosis.conclusion.guard import gains, rms_um
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
    return AsGiven(rms_um(structure, own), rms_um(structure, none), gains(structure, none, own).worse)


def _residual(structure: Structure, given: ErrorModel | None) -> Array:
    """Whitened residuals `(N,)` of a calibration alone, or of the nominal machine."""
    data = structure.data.observations
    observations = replace(Observations.of(data.measurement, given=given), specified=data.specified)
    return Whitener.of(observations, stops_of(observations), structure.noise).residual
