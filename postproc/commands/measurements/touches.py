"""`ncomp touches`: the log of a probing program in, a measurement file out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, argument, option
from postproc.commands.options.shared import MachineName, ResultOptions, check_files, whole_results
from rendering.report import Report, Section, Table, facts

if TYPE_CHECKING:
    from calibration.probing.centres import Probed
    from kinematics.files.report_head import ReportHead

EPILOG = (
    "Examples:\n\n"
    "`ncomp touches ncomp48211.txt --machine dmu50 --plan spheres.csv -o data.csv`\n\n"
    "then `ncomp fit data.csv --machine dmu50 -o cal.json`"
)


def touches(
    *,
    log: Path = argument("Log of the probing program, as the control wrote it.", "LOG.txt"),
    machine: MachineName,
    plan: Path = option("Plan of which it is the log.", "PLAN.csv", default=REQUIRED),
    output: str = option("File for the measurement; `-` is standard output.", "DATA.csv", "-o", default=REQUIRED),
    others: ResultOptions,
) -> None:
    """Read the log of a probing program: centres of the spheres, their scatter, and the drift between repetitions.

    The uncertainty of a centre (u_um of the measurement file) follows from the scatter of its contacts.
    """
    from calibration.measurement.file import write_measurement
    from calibration.measurement.plan_file import read_plan, stated_plan_id
    from calibration.probing.centres import centres_of
    from calibration.probing.log import log_text, read_contacts
    from calibration.reports.head import measured_head
    from kinematics.files import read_input
    from postproc.commands.show.terminal import say, show

    inputs = check_files((log, plan), {"--output": output, **others.by_option})
    found = ncomp.load_machine(machine)
    planned = read_plan(plan, found)
    if not planned.spheres:
        raise UserError(f"{plan}: this is no plan of spheres (ncomp plan --instrument touch-probe)")
    contacts = read_contacts(log_text(read_input(log, "log"), log.name), log.name, planned, stated_plan_id(plan))
    probed = centres_of(contacts, planned, log.name)
    head = measured_head(probed.measurement, None, f"ncomp touches {log} --machine {machine} --plan {plan}")
    report = touches_report(probed, log.name, head)
    for note in probed.notes:
        say("note", note)
    with whole_results(output, *others.files) as (file, *files):
        write_measurement(probed.measurement, file)
        others.write(touches_json(probed), report, tuple(files), inputs)
    show(report, output, *others.files)


def touches_json(probed: Probed) -> dict[str, Any]:
    """The result for programs."""
    return {
        "centres": len(probed.measurement),
        "scatter_um": probed.scatter_um,
        "u_um": probed.u_um,
        "contact_radius_mm": probed.radii,
        "repeats": [
            {"row": each.row + 1, "shift_um": each.shift_um.tolist(), "U_um": each.U_um, "drift": each.significant}
            for each in probed.repeats
        ],
        "notes": list(probed.notes),
    }


def touches_report(probed: Probed, lead: str, head: ReportHead) -> Report:
    """The result for people."""
    rows = [
        ("centres", str(len(probed.measurement))),
        ("scatter of the contacts", "-" if probed.scatter_um is None else f"{probed.scatter_um:.2f} um (k = 1)"),
        ("uncertainty of a centre", f"{probed.u_um:.2f} um in each coordinate (k = 1)"),
        *((f"radius of contact {name}", f"{radius:.4f} mm") for name, radius in probed.radii.items()),
    ]
    repeats = [
        (
            str(each.row + 1),
            *(f"{v:+.1f}" for v in each.shift_um),
            f"{each.U_um:.1f}",
            "drift" if each.significant else "",
        )
        for each in probed.repeats
    ]
    sections = [facts("Contacts", rows)]
    if repeats:
        text = "The first centre, measured again, has these shifts in the workpiece frame, um, with U (k = 2)."
        sections.append(
            Section("Repetitions", text, Table(("row", "x, um", "y, um", "z, um", "U, um", "result"), repeats))
        )
    return Report("Touches of spheres", lead, sections, _verdict(probed), head=head)


def _verdict(probed: Probed) -> str:
    drifted = [each for each in probed.repeats if each.significant]
    if not probed.repeats:
        return "The first centre was not measured again: a drift would not show."
    if not drifted:
        return "No drift: the first centre, measured again, has not moved by more than its uncertainty."
    last = max(drifted, key=lambda each: float(abs(each.shift_um).max()))
    moved = ", ".join(f"{v:+.1f}" for v in last.shift_um)
    return (
        f"DRIFT: the first centre moved by ({moved}) um until row {last.row + 1}, beyond U {last.U_um:.1f} um: "
        "spheres, spindle or table moved or warmed up. ncomp diagnose separates a drift (thermal-drift) from a knock "
        "(station-shift)."
    )
