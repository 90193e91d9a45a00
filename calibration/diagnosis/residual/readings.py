"""Unexplained errors of a tracker's readings: smooth functions of azimuth, elevation and distance.

An error of the instrument that no cause of the library describes looks like several errors of the machine that depend
on two positions at once. The function acts on one reading (distance, azimuth or elevation).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, READINGS, Function
from calibration.diagnosis.residual.unnamed import MOST_TERMS, ROWS_PER_TERM, evidence, terms_of
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.row_sensitivity import RowSensitivity
from calibration.measurement.measurement import Measurement
from kinematics.effects.combined.where import beam
from kinematics.transforms import Array

SETS = (READINGS[:2], READINGS[::2], READINGS)
"""Sets of variables that are tried, each with `TRIED` lengths that all its variables share."""
TRIED = LENGTHS[2:]
TYPICAL = 1e-5
"""Error in whose units the amplitude is chosen: m of 10 um, rad of 10 urad."""


class OfReadings(NamedTuple):
    """A linearised fit with functions of the readings beside the model."""

    linearised: LinearisedFit
    log_odds: float = 0.0
    """Log odds of these functions against none."""
    function: Function | None = None
    """The clearest of them; None without any."""


class _Tried(NamedTuple):
    log_odds: float
    number: int
    """Number of the reading: distance, azimuth, elevation."""
    function: Function
    sensitivity: RowSensitivity
    values: Array
    """Values `(n, k)` of its terms, in units of their most likely standard deviations."""


def readings(measurement: Measurement, rows: np.ndarray) -> dict[str, Array]:
    """Azimuth and elevation, rad, and distance, mm, `(n,)` of a tracker's readings; empty for others.

    The azimuth counts from its mean direction.
    """
    if not measurement.instrument.BY_BEAM or measurement.state.observed is None:
        return {}
    points = measurement.state.observed[rows]
    azimuth, elevation = beam(points).angles.T
    turned = np.exp(1j * azimuth)
    read = np.angle(turned * np.conj(turned.mean())), elevation, np.linalg.norm(points, axis=1)
    return {name: values for name, values in zip(READINGS, read, strict=True) if np.ptp(values) > 0.0}


def with_function_of_readings(linearised: LinearisedFit) -> OfReadings:
    """The linearised fit with a function for each reading that needs one, the clearest first."""
    found = OfReadings(linearised)
    given = readings(linearised.measurement, linearised.rows)
    if not given or linearised.state.observed is None:
        return found
    seen = beam(linearised.state.observed)
    units = np.stack([1e3 * seen.direction, seen.sideways, seen.upwards])
    arms = dict(enumerate(TYPICAL * np.einsum("ndk,ank->and", linearised.transform[:, :, -3:], units)))
    while arms:
        best = max(_tried(found.linearised, given, arms), key=lambda each: each.log_odds)
        if best.log_odds <= EVIDENCE:
            break
        beside = found.linearised.beside(best.sensitivity.columns(best.values))
        found = OfReadings(beside, found.log_odds + best.log_odds, found.function or best.function)
        del arms[best.number]
    return found


def _tried(linearised: LinearisedFit, given: Mapping[str, Array], arms: Mapping[int, Array]) -> Iterator[_Tried]:
    """Functions of each set of variables and length, for each of the readings with derivatives `(n, d)`, `arms`."""
    most = min(MOST_TERMS, len(linearised.rows) // ROWS_PER_TERM)
    read = {number: RowSensitivity.of(linearised, arm) for number, arm in arms.items()}
    for variables in SETS:
        if not given.keys() >= set(variables):
            continue
        for length in TRIED:
            function = Function(variables, (length,) * len(variables))
            degrees, spread = terms_of(function.lengths, most)
            values = spread * reduce(np.multiply, map(_polynomials, (given[name] for name in variables), degrees.T))
            for number, sensitivity in read.items():
                log_odds, size = evidence(*sensitivity.parts(values))
                yield _Tried(log_odds, number, function, sensitivity, size * values)


def _polynomials(values: Array, degrees: np.ndarray) -> Array:
    """Legendre polynomials `(n, k)` of these degrees `(k,)` over the range of the values `(n,)`."""
    unit = 2.0 * (values - values.min()) / np.ptp(values) - 1.0
    return np.asarray(legendre.legvander(unit, int(degrees.max()))[:, degrees])
