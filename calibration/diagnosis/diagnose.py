"""A diagnosis, from a measurement to its answer."""

from __future__ import annotations

import math

import numpy as np

from calibration.diagnosis.axis_order import other_order
from calibration.diagnosis.conclusion.result import Diagnosis, answered
from calibration.diagnosis.search import search
from calibration.fit.acceptance import SPARE_SHARE, information
from calibration.fit.set_up.checked_data import CheckedData
from calibration.fit.set_up.moved_spheres import moved_findings
from calibration.gaussian_terms.geometry import motions
from calibration.gaussian_terms.given.larger_range import extended, larger_ranges
from calibration.gaussian_terms.observations import Observations
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from kinematics.error_model.model import ErrorModel
from kinematics.running.progress import Progress, numbered, silent
from kinematics.user_error import UserError

KNOCK = "station-shift"
"""Kind of a cause that tells that a sphere, or an instrument, was moved."""
DIAGNOSIS_STEPS = 3
"""Steps of a diagnosis: the data, the search, the conclusions."""
PARAMETERS_OF_A_BOW = 3
"""Parameters of an error motion that rows must be able to determine: a constant, a slope and a bow."""


def diagnose(
    measurement: Measurement,
    calibration: ErrorModel | None = None,
    *,
    force: bool = False,
    add_unexplained: bool = False,
    progress: Progress = silent,
) -> Diagnosis:
    """The diagnosis of a measurement against a calibration, without one against the nominal machine.

    force: the new calibration is accepted although it predicts worse than the other one. add_unexplained: it corrects
    functions without a name too, as far as it can. UserError where the measurement is not plausible, or has too few
    rows.
    """
    checking, searching, concluding = (
        numbered(progress, number, DIAGNOSIS_STEPS) for number in range(1, DIAGNOSIS_STEPS + 1)
    )
    checking("checking the data")
    data = CheckedData.of_diagnosis(measurement)
    measurement, findings = data.measurement, data.findings
    given = None
    if calibration is not None:
        given, further = _of_other_data(calibration, measurement)
        findings = (*findings, *further)
    observations = Observations.of(measurement, given=given)
    if given is None:
        _refuse_few(observations)
    searching("error motions and noise")
    found = search(observations, searching)
    if chain := other_order(found.structure):
        findings = (*findings, Finding("chain", chain, False))
    if all(term.kind != KNOCK for term in found.structure.terms):
        findings = (*findings, *moved_findings(measurement, force=force))
    concluding("verdicts and calibration")
    return answered(found.candidates, findings, force=force, add_unexplained=add_unexplained)


def _of_other_data(calibration: ErrorModel, measurement: Measurement) -> tuple[ErrorModel | None, list[Finding]]:
    """The calibration of the machine over the ranges of a measurement, with findings; None where it is of these data.

    What a measurement has told once counts once.
    """
    if measurement.fingerprint and measurement.fingerprint in calibration.provenance.inputs.values():
        text = "the calibration was made from these data: they are diagnosed without it"
        return None, [Finding("calibration", text, False)]
    own = calibration.part(lambda effect: effect.ACTS_ON != "instrument")
    ranges = larger_ranges(own, measurement)
    findings = []
    for name, (known, whole) in ranges.items():
        unit = measurement.machine.axes[measurement.machine.index(name)].unit
        text = (
            f"{name} was calibrated from {known[0]:.4g} to {known[1]:.4g} {unit}, which these data extend to "
            f"{whole[0]:.4g} to {whole[1]:.4g} {unit}: its error motions beyond follow from these data alone"
        )
        findings.append(Finding("range", text, False))
    return extended(own, measurement.machine, ranges), findings


def _refuse_few(observations: Observations) -> None:
    """UserError where the rows cannot determine the registration and the error motions of the axes that move."""
    measurement = observations.measurement
    moving, registered = list(measurement.moving), observations.registration.shape[2]
    of_motions = PARAMETERS_OF_A_BOW * len(motions(measurement))
    unknown, known = registered + of_motions, information(measurement)
    if not moving:
        raise UserError(f"{measurement.source}: no axis moves: measure positions at which an axis moves")
    few = known < unknown and observations.components > 1  # of one component, runs repeat their few targets
    if few or measurement.observed.size * (1.0 - SPARE_SHARE) < unknown:
        positions = math.ceil(unknown / (1.0 - SPARE_SHARE) / observations.components)
        advice = f"measure about {positions} positions or more, spread over the travel"
        stations = len(np.unique(measurement.groups))
        if stations > 1 and known < registered + len(moving):
            advice = f"measure more positions from each of the {stations} set-ups of the instrument"
        advice = measurement.instrument.IF_TOO_FEW or advice
        raise UserError(
            f"{measurement.source}: {len(measurement)} rows ({measurement.observed.size} observations) are too few for "
            f"{unknown} parameters at least: {registered} of the registration, {of_motions} of the error motions of "
            f"{', '.join(moving)}; {advice}"
        )
