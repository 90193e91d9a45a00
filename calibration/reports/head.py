"""The head of a report on measured data."""

from __future__ import annotations

from calibration.measurement.measurement import Measurement
from kinematics.error_model.model import ErrorModel
from kinematics.files.report_head import ReportHead, calibration_text
from kinematics.state import REFERENCE_DEGC
from kinematics.transforms import Array


def measured_head(measurement: Measurement, model: ErrorModel | None, command: str) -> ReportHead:
    """The entries that are known of a measurement and of the calibration that was made from it."""
    machine = measurement.machine
    return machine.report.filled(
        machine=machine.name,
        temperature=_temperatures(measurement),
        measured="" if measurement.measured is None else str(measurement.measured),
        instrument=instrument_text(measurement.instrument.kind(), measurement.simulated),
        calibration="" if model is None else calibration_text(model),
        command=command,
    )


def instrument_text(kinds: str, simulated: bool) -> str:
    """The instruments, marked where they measured a virtual machine."""
    return f"{kinds} (simulated)" if simulated else kinds


def foot_of(title: str, lead: str, model: ErrorModel | None) -> str:
    """The text at the foot of each printed sheet, with the calibration that was written."""
    return " · ".join((title, lead, *([] if model is None else [f"calibration {model.id}"])))


def _temperatures(measurement: Measurement) -> str:
    """Lowest and highest temperature of each sensor during the measurement."""
    return ", ".join(f"{_range(values)} ({name})" for name, values in measurement.state.temperatures.items())


def _range(values: Array) -> str:
    low, high = (f"{value + REFERENCE_DEGC:.1f}" for value in (values.min(), values.max()))
    return f"{low} °C" if low == high else f"{low} to {high} °C"
