"""`ncomp check --control-kinematics`: the lines of rotary axes by machine file, measurement, control and CAM."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MODEL, option
from postproc.commands.options.files import file_of_calibration
from postproc.commands.options.shared import ResultOptions, whole_results
from rendering.report import Report, Section, Table

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.control_data.parameters.agreement import Difference

FILE, MEASURED, CONTROL, CAM = "machine file", "measured", "control", "CAM"
HEAD = ("axis", "compared", "second minus first, mm (X, Y, Z)", "tilt, deg", "turns", "a part shows, mm")
ABOUT = (
    "The differences are those of the lines across themselves, in the machine frame with all axes at 0. What a part "
    "shows: the distance between two features that are cut with the axis at 0 and at this angle, if one of the two "
    "sources positions the tool by the line of the other. Under TCP the lines of the control count; with positions of "
    "the axes from the CAM system those of its post-processor."
)


@dataclass(frozen=True, kw_only=True)
class KinematicsOptions:
    """Kinematics to compare with the machine file, without a program."""

    PANEL: ClassVar[str] = "Kinematics, without a program"

    control_kinematics: tuple[Path, ...] = option(
        "Kinematics in the control: a machine file, or its kinematic parameters (docs/kinematic_parameters.md).",
        "FILE",
        reads=True,
    )
    cam_kinematics: tuple[Path, ...] = option(
        "Kinematics in the CAM system or its post-processor, likewise.", "FILE", reads=True
    )
    calibration: str | None = option(
        "Calibration: the measured lines are compared as well.",
        "CAL.json",
        "-c",
        reads=file_of_calibration,
        panel=MODEL,
    )

    @property
    def given(self) -> bool:
        """True if kinematics are compared."""
        return bool(self.control_kinematics or self.cam_kinematics or self.calibration)

    def compare(self, machine: str, program: str | None, others: ResultOptions) -> None:
        """Compare the kinematics; UserError together with a program, and without kinematics."""
        if program is not None:
            raise UserError(
                f"{program}: the check of a program needs no calibration and no other kinematics: its lines are the "
                "same for each of them. Leave out --calibration, --control-kinematics and --cam-kinematics; or leave "
                "out the program, to compare the lines of the rotary axes"
            )
        if not self.given:
            raise UserError("give a program; or --control-kinematics, --cam-kinematics or --calibration to compare")
        _compare(machine, self, others)


def _compare(machine: str, options: KinematicsOptions, others: ResultOptions) -> None:
    """Compare the lines and senses of the rotary axes by all sources, and show the differences."""
    from postproc.commands.show.terminal import show
    from postproc.control_data.parameters.agreement import differences, measured_lines
    from postproc.control_data.parameters.stated_lines import stated_lines

    found, u = ncomp.load_machine(machine), dict[str, float]()
    sources = {FILE: found}
    if options.calibration is not None:
        sources[MEASURED], u = measured_lines(found, ncomp.load_calibration(found, options.calibration), 0.0)
    for name, paths in ((CONTROL, options.control_kinematics), (CAM, options.cam_kinematics)):
        if paths:
            sources[name] = stated_lines(found, paths)
    rows = differences(sources, u, MEASURED)
    report = _report(found, rows)
    inputs = (options.calibration, *options.control_kinematics, *options.cam_kinematics)
    with whole_results(*others.files) as files:
        agree = all(each.agrees for each in rows)
        others.write({"agree": agree, "differences": [each.json() for each in rows]}, report, files, inputs)
    show(report, *others.files)


def _report(machine: Machine, rows: Sequence[Difference]) -> Report:
    """The differences, those that count first."""
    differing = [each for each in rows if not each.agrees]
    verdict = "\n".join(map(_sentence, differing)) or "The lines and senses of all rotary axes agree."
    table = Table(HEAD, [_row(each) for each in (*differing, *(each for each in rows if each.agrees))])
    head = machine.report.filled(machine=machine.name)
    return Report(
        f"Kinematics of {machine.name}", "", [Section("Lines of the rotary axes", ABOUT, table)], verdict, head=head
    )


def _sentence(each: Difference) -> str:
    """What differs, and what a part shows."""
    if not each.same_sense:
        return f"{each.axis} TURNS THE OTHER WAY by {each.second} than by {each.first}: correct its sign first."
    size = sum(value**2 for value in each.part_mm) ** 0.5
    return (
        f"{each.axis} by {each.second} is {_numbers(each.shift_mm)} mm from {each.first}: features cut at "
        f"{each.axis} 0 and at {each.axis} {each.turn_deg:g} are {size:.4f} mm apart on the part."
    )


def _row(each: Difference) -> tuple[str, ...]:
    uncertain = f" (U {2.0 * each.u_mm:.4f}, k=2)" if each.u_mm else ""
    part = f"{_numbers(each.part_mm)} at {each.turn_deg:g} deg" if each.same_sense else ""
    return (
        each.axis,
        f"{each.first}, {each.second}",
        f"{_numbers(each.shift_mm)}{uncertain}",
        f"{each.tilt_deg:.5f}",
        "alike" if each.same_sense else "THE OTHER WAY",
        part,
    )


def _numbers(vector: Sequence[float]) -> str:
    return ", ".join(f"{value:+.4f}" for value in vector)
