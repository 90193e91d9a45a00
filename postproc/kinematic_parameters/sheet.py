"""The page sheet.md beside kinematic parameters: the changes, their meaning, loading, certainty, remaining errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from postproc.kinematic_parameters.export import ExportedParameters
from postproc.tables.not_representable import Unrepresented
from postproc.tables.sheet import STAGES as TABLE_STAGES

STAGES = {
    "before": TABLE_STAGES["before"],
    "before_and_datum_shift": "without compensation, work offset touched off again",
    "after_parameters": "with these parameters and the old work offset",
    "after_parameters_and_datum_shift": "with these parameters, work offset touched off again",
    "after_parameters_datum_shift_and_tables": "the same, with the control's tables for the remaining errors",
    "after_nc_correction": "with corrected programs and the old parameters",
    "after_parameters_and_nc_correction_of_the_rest": "with these parameters and programs corrected for the rest",
}
WHERE = (
    "Kinematic parameters act only where the control positions the tool point (TCP: G43.4, TRAORI, M128, kinematics of "
    "LinuxCNC) and in tilted planes. Programs of axis positions do not change: correct them with the whole calibration."
)


def sheet(exported: ExportedParameters, left: Iterable[Unrepresented], volume: dict[str, Any]) -> str:
    """The text of sheet.md, Markdown."""
    return "\n".join(_lines(exported, left, volume)) + "\n"


def _lines(exported: ExportedParameters, left: Iterable[Unrepresented], volume: dict[str, Any]) -> Iterator[str]:
    form, whole = exported.format, exported.whole
    yield f"# {form.title}: machine {exported.machine.name}"
    yield ""
    yield f"Calibration {whole.id} of {whole.provenance.made_at:%Y-%m-%d}, tool length {-exported.tool[2]:zg} mm."
    if whole.invented:
        yield "**Demonstration calibration: it describes no real machine. Do not load these parameters.**"
    yield from ["", WHERE, "", f"**Work offset: {offset_shift(exported)}.**"]
    origin = "known for this format" if form.sign else "as given by --sign; no source confirms it"
    meant = "have the direction described here" if exported.sign == "correction" else "are reversed"
    yield from ["", "## Meaning of the numbers", "", form.meaning, "", f"The changes {meant}: {origin}."]
    yield from ["", "## How to load them", "", form.loading, "", "## How certain this is", "", form.certainty]
    yield from ["", "## Parameters", "", "| parameter | by the machine file | new | change | unit |"]
    yield "|---|---|---|---|---|"
    yield from (f"| {' | '.join(row)} |" for row in number_rows(exported))
    yield from ["", "## Lines of the rotary axes", "", "Shifts and tilts of the lines at zero pose, machine frame:", ""]
    yield from ["| line | change | U (k = 2) |", "|---|---|---|"]
    yield from (f"| {name} | {value} | {u} |" for name, value, u in line_rows(exported))
    yield from ["", "## Remaining errors", "", "Tool point error over the working volume, um, by the exact model:", ""]
    yield from ["| | RMS | 95 % | max |", "|---|---|---|---|"]
    for stage, numbers in volume["tool_point_um"].items():
        yield f"| {STAGES[stage]} | {numbers['rms']:.2f} | {numbers['p95']:.2f} | {numbers['max']:.2f} |"
    yield from ["", "Not in the parameters (RMS at the tool point, um):", ""]
    yield from (
        f"- {each.name}: {'-' if math.isnan(each.rms_um) else f'{each.rms_um:.2f}'}, {each.why}" for each in left
    )


def number_rows(exported: ExportedParameters) -> list[tuple[str, ...]]:
    """Name, value by the machine file, new value, change and unit of each number in the control."""
    rows: list[tuple[str, ...]] = []
    for old, new in zip(*exported.numbers, strict=True):
        change = f"{new.value - old.value:+z.{new.decimals}f}"
        rows.append((new.name, old.text, new.text, change, new.unit))
    return rows


def line_rows(exported: ExportedParameters) -> list[tuple[str, str, str]]:
    """Freedom, change and U (k = 2) of each line, with units."""
    return [
        (each.freedom.name, f"{each.value:+.2f} {each.freedom.unit}", f"{2.0 * each.u:.2f} {each.freedom.unit}")
        for each in exported.changes
    ]


def offset_shift(exported: ExportedParameters) -> str:
    """The change of work offsets that belongs to the parameters."""
    shift, turn = np.split(exported.best.frame, 2)
    text = ", ".join(f"{letter} {value:+.4f}" for letter, value in zip("XYZ", shift.tolist(), strict=True))
    aligned = ", ".join(f"{letter} {value * 1e6:+.2f}" for letter, value in zip("ABC", turn.tolist(), strict=True))
    alignment = f" and turned by {aligned} urad about the axes of the machine" if turn.any() else ""
    return (
        "touch the workpiece off again after the parameters are set. On the average of the volume a work offset that "
        f"stays on its workpiece is shifted by {text} mm{alignment}"
    )
