"""Errors of a machine at the tool point, over the measured states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calibration.evaluation.volumetric import volumetric_error_um
from calibration.fit.prediction import LEVER_ARM_MM, measures_angles
from calibration.measurement.measurement import Measurement
from kinematics.deviation import exact_deviation
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.transforms import Array


class Volume(NamedTuple):
    """Deviations of the tool over the measured states, RMS and largest length, um."""

    machine_rms: float
    """Deviation of the machine, by the new model."""
    machine_max: float
    left_rms: float
    """Deviation that a correction by the present model leaves, by the new model."""
    left_max: float


def volume(measurement: Measurement, new: ErrorModel, present: ErrorModel) -> Volume:
    """Deviations over the measured states, by the machine's part of both models, after rigid alignment."""
    machine, state = measurement.machine, measurement.state
    q = state.positions
    tool = np.full((len(q), 3), LEVER_ARM_MM) if measures_angles(measurement) else measurement.tool

    def deviation(model: ErrorModel) -> Array:
        own = model.part(lambda effect: effect.ACTS_ON != "instrument")
        return exact_deviation(machine, q, own.errors(machine, state), tool).position

    by_new, by_present = deviation(new), deviation(present)
    points = tool_point(machine, q, tool)
    whole, change = volumetric_error_um(by_new, points), volumetric_error_um(by_new - by_present, points)
    return Volume(whole.rms, whole.largest, change.rms, change.largest)
