"""Change of a machine since its present calibration, as text and JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from calibration.evaluation.machine_change import MachineChange
from calibration.reports.causes import text as words
from kinematics.effects import Effect
from kinematics.error_model.covariance import COVERAGE_FACTOR
from rendering.report import Section, Table, shortened

LISTED_CHANGES = 4
"""Most changed lines in a sentence; the table has all."""
UNMOVED_UM = 1e-6
"""Uncertainty of the difference below which no parameter of the models moves the tool point."""


def machine_change_json(change: MachineChange | None) -> dict[str, Any] | None:
    """The change for programs; None without a present calibration of other data."""
    if change is None:
        return None
    changed = [line.name for line in change.changed]
    return {
        "rms_um": change.rms_um,
        "u_um": change.u_um,
        "max_um": change.max_um,
        "significant": change.significant,
        "lines": [
            {
                "name": line.name,
                "meaning": line.line_name,
                "axis": line.axes[0],
                "value": line.parameters[0],
                "u": line.uncertainties[0],
                "unit": line.parameter_table[0].unit,
                "significant": line.name in changed,
            }
            for line in change.lines
        ],
    }


def change_sentences(change: MachineChange | None) -> Iterator[str]:
    """The change in a sentence or two; none without a present calibration of other data."""
    if change is None:
        return
    if change.u_um < UNMOVED_UM:
        yield "The axes turn about the tool point alone: a change of the machine has no figure in um."
        return
    size = f"{change.rms_um:.2g} um RMS over the measured volume (at most {change.max_um:.2g} um)"
    if not change.significant:
        yield (
            f"No change of the machine: new and present model differ by {size}; their uncertainties alone explain "
            f"{change.u_um:.2g} um."
        )
        return
    lines = shortened([f"{line.line_name} {_size(line)}" for line in change.changed], LISTED_CHANGES, "lines")
    listed = f" {'; '.join(lines)}." if lines else ""
    yield (
        f"CHANGED since the present calibration: {size}, where the uncertainties alone explain {change.u_um:.2g} um."
        f"{listed}"
    )


def change_sections(change: MachineChange | None) -> Iterator[Section]:
    """The table of all location errors and scales."""
    if change is None or not change.lines:
        return
    changed = [line.name for line in change.changed]
    rows = [
        (line.line_name, line.name, _size(line), "changed" if line.name in changed else "")
        for line in sorted(change.lines, key=lambda line: line.name not in changed)
    ]
    text = (
        "Changes are new model minus present calibration. A scale is the mean slope of a positioning error. Location "
        "errors are by ISO 230-1 in the datum of the calibration, with the U "
        f"(k={COVERAGE_FACTOR:g}) of the difference of both."
    )
    yield Section(
        "Change since the present calibration", text, Table(("error", "symbol", "change ± U", "result"), rows)
    )


def _size(line: Effect) -> str:
    value, unit = line.parameters[0], line.parameter_table[0].unit
    return f"{'+' if value > 0.0 else ''}{words.with_uncertainty(value, line.uncertainties[0])} {unit}"
