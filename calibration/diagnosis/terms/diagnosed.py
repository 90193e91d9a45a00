"""A diagnosis by terms, from a measurement to its answer."""

from __future__ import annotations

import math

from calibration.diagnosis.terms.conclusion.answer import Answer, answered
from calibration.diagnosis.terms.search import search
from calibration.fit.acceptance import information
from calibration.fit.set_up.checked_data import checked_data
from calibration.gaussian_terms.observations import Observations
from calibration.measurement.measurement import Measurement
from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError

LEAST = 24
"""Parameters of an axis that rows must be able to determine: six cubics, as of `calibration.fit.acceptance`."""


def diagnosed(measurement: Measurement, *, force: bool = False, progress: Progress = silent) -> Answer:
    """The diagnosis of a measurement by one laser tracker, without a calibration.

    force: the calibration is accepted although it predicts worse than none. UserError where the measurement is of
    another instrument, is not plausible, or has too few rows.
    """
    if not measurement.instrument.BY_BEAM:
        raise UserError(
            f"{measurement.source}: --engine terms is for laser trackers, and these data are of another instrument: "
            "leave out --engine"
        )
    progress("checking the data")
    measurement, findings, _ = checked_data(measurement, misplaced=False)
    observations = Observations.of(measurement)
    _refuse_few(observations)
    found = search(observations, progress)
    progress("verdicts and calibration")
    return answered(found.candidates, findings, force=force)


def _refuse_few(observations: Observations) -> None:
    """UserError where the rows cannot determine the error motions of the axes that move."""
    measurement = observations.measurement
    moving = list(measurement.moving)
    unknown = observations.registration.shape[2] + LEAST * len(moving)
    if not moving:
        raise UserError(f"{measurement.source}: no axis moves: measure positions at which an axis moves")
    if information(measurement) < unknown:
        positions = math.ceil(unknown / observations.components)
        raise UserError(
            f"{measurement.source}: {len(measurement)} rows are too few for the error motions of "
            f"{', '.join(moving)}: measure about {positions} positions or more, spread over the travel"
        )
