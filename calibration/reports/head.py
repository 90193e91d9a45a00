"""The head of a report on measured data."""

from __future__ import annotations

from calibration.measurement.instruments import kind_of
from calibration.measurement.measurement import Measurement
from kinematics.error_model.model import ErrorModel
from kinematics.report_head import ReportHead
from kinematics.state import REFERENCE


def measured_head(measurement: Measurement, model: ErrorModel | None, command: str) -> ReportHead:
    """The entries that are known of a measurement and of the calibration that was made from it."""
    machine = measurement.machine
    return machine.report.filled(
        machine=machine.name,
        temperature=_temperatures(measurement),
        instrument=kind_of(measurement.instrument),
        calibration="" if model is None else calibration_text(model),
        command=command,
    )


def calibration_text(model: ErrorModel) -> str:
    """Identifier and date of a calibration."""
    return f"{model.id}, made {model.provenance.made_at:%Y-%m-%d}"


def _temperatures(measurement: Measurement) -> str:
    """Lowest and highest temperature of each sensor during the measurement."""
    ranges = [
        f"{name} {values.min() + REFERENCE:.1f} to {values.max() + REFERENCE:.1f} °C"
        for name, values in measurement.state.temperatures.items()
    ]
    return ", ".join(ranges)
