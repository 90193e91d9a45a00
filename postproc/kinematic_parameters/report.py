"""The report of an export of kinematic parameters: the changes, and the errors that they leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from kinematics.files.report_head import calibration_text
from postproc.kinematic_parameters.export import ExportedParameters
from postproc.kinematic_parameters.sheet import STAGES, WHERE, line_rows, number_rows, offset_shift
from postproc.tables.not_representable import Unrepresented
from postproc.tables.report import flowing, left_section, remaining_section
from rendering.report import Report, Section, Table

DEMONSTRATION = "DEMONSTRATION CALIBRATION: it describes no real machine; do not load its parameters."
AFTER = "after_parameters_and_datum_shift"


def parameters_report(
    exported: ExportedParameters, left: Sequence[Unrepresented], volume: dict[str, Any], folder: str
) -> Report:
    """The result for people; `volume`: the errors that remain."""
    machine, whole, point = exported.machine, exported.whole, volume["tool_point_um"]
    stage = AFTER if AFTER in point else "after_parameters"
    verdict = [
        *([DEMONSTRATION] if whole.invented else []),
        f"Tool point error over the volume: {point['before']['rms']:.2f} -> {point[stage]['rms']:.2f} um RMS, at most "
        f"{point['before']['max']:.2f} -> {point[stage]['max']:.2f} um, {STAGES[stage]}.",
        f"Work offset: {offset_shift(exported)}.",
    ]
    head = machine.report.filled(machine=machine.name, calibration=calibration_text(whole))
    sections = list(_sections(exported, left, volume))
    return Report(f"{exported.format.title}: machine {machine.name}", folder, sections, "\n".join(verdict), head=head)


def _sections(exported: ExportedParameters, left: Sequence[Unrepresented], volume: dict[str, Any]) -> Iterator[Section]:
    yield remaining_section("volume", volume, STAGES)
    head = ("parameter", "by the machine file", "new", "change", "unit")
    yield Section("Parameters", WHERE, Table(head, list(number_rows(exported))))
    text = "The table has the shifts and tilts of the lines of the rotary axes at zero pose, in the machine frame."
    yield Section("Lines of the rotary axes", text, Table(("line", "change", "U (k=2)"), list(line_rows(exported))))
    yield from left_section("Not in the parameters", left)
    form = exported.format
    origin = "known for this format" if form.sign else "as given by --sign; no source confirms it"
    meant = "have the direction described here" if exported.sign == "correction" else "are reversed"
    yield Section("Meaning of the numbers", f"{flowing(form.meaning)}\nThe changes {meant}: {origin}.")
    yield Section("Loading into the control", flowing(form.loading))
    yield Section("Certainty", flowing(form.certainty))
